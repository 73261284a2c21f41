"""What a round of the search logs: what was not replayed, and what became of all that was."""

from __future__ import annotations

from collections.abc import Sequence

from wt.diagnose.likelihood.bic import worth
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.residual.screen import Scored
from wt.diagnose.result import Stage
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Shape
from wt.physics.planted import Planted
from wt.types import Location


def log_screened(
    log: DecisionLog, ranked: Sequence[Scored], tried: Sequence[tuple[Planted, Shape | None]]
) -> None:
    """Log what the force residual shows too little of to be replayed."""
    replayed = {p.key for p, _ in tried}
    for s in (s for s in ranked if s.planted.key not in replayed):
        least = THRESHOLDS.replay_share * ranked[0].gain
        log.add(s.planted, "screened", False, s.gain, least, "not replayed: others show far more")


def log_replays(
    log: DecisionLog,
    objective: Objective,
    fits: Sequence[Assessed],
    now: Assessed,
    best: Assessed | None,
) -> None:
    """Log what became of each hypothesis that was replayed; ``best`` joins, if there is one."""
    for fit in fits:
        planted, gain = fit.hypothesis[-1], worth(objective, fit, now)
        pair = len(fit.hypothesis) > len(now.hypothesis) + 1
        partner = f", with {_seen_from(planted.at, fit.hypothesis[-2])}" if pair else ""
        if best is None:
            reason, threshold = "gains too little", THRESHOLDS.min_nats
        elif fit is best:
            reason, threshold = "the best addition", THRESHOLDS.min_nats
        else:
            winner = _seen_from(planted.at, best.hypothesis[-1])
            reason, threshold = f"beaten by {winner}", worth(objective, best, now)
        why = planted.wrong(objective.motion)
        if why is not None:
            reason = why
        stage: Stage = "joined" if fit is best else "replayed"
        log.add(planted, stage, fit is best, gain, threshold, reason + partner)


def _seen_from(at: Location, planted: Planted) -> str:
    """An effect in words at a place: without its own place where that is the same."""
    return planted.effect.id if planted.at == at else str(planted)
