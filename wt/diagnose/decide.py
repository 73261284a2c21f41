"""The search: one effect at a time is added, and dropped again if it stops earning its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wt.diagnose.hypotheses import candidates
from wt.diagnose.objective import Assessed, Hypothesis, Objective
from wt.diagnose.refine import evaluate, refine
from wt.diagnose.result import Considered
from wt.diagnose.screen import Screen
from wt.physics.effect import Shape
from wt.physics.replay import Planted

Array = np.ndarray
Report = Callable[[str, float], None]

MOST_EFFECTS = 8
MIN_NATS = 12.0
"""Log-likelihood an effect must gain after the price of its parameters."""
MIN_DROP = 0.15
"""… and the share of some joint's mean square error that it must remove."""
EQUIVALENT_NATS = 4.0
"""Hypotheses closer than this cannot be told apart."""
_STARTS, _PROMISING, _FINALISTS = 24, 8, 4
"""How many hypotheses of a round get one step, two more steps, and all effects refined."""


@dataclass(frozen=True, eq=False)
class Rival:
    """A hypothesis that was replayed in place of an accepted one."""

    planted: Planted
    loglik: float


@dataclass(frozen=True, eq=False)
class Accepted:
    """An effect that earned its place.

    Attributes:
        planted: effect, place, parameters.
        shape: of its signature, if it has one.
        gain: log-likelihood gained when it was added, after its price [nats].
        rivals: what was replayed in its place and came close.
    """

    planted: Planted
    shape: Shape | None
    gain: float
    rivals: tuple[Rival, ...]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the search found.

    Attributes:
        accepted: effects in the order they were added.
        assessed: all of them together on the replays of the search.
        nominal: the model as given, likewise.
        considered: every hypothesis that was screened high or replayed.
    """

    accepted: tuple[Accepted, ...]
    assessed: Assessed
    nominal: Assessed
    considered: tuple[Considered, ...]


def search(screen: Screen, objective: Objective, report: Report | None = None) -> Outcome:
    """Add effects while they earn their place."""
    accepted: list[Accepted] = []
    considered: list[Considered] = []
    now = nominal = objective.reference(())
    while len(accepted) < MOST_EFFECTS:
        if report:
            report(
                f"looking for effect {len(accepted) + 1}",
                0.15 + 0.55 * len(accepted) / MOST_EFFECTS,
            )
        found = _best_addition(screen, objective, now, accepted, considered)
        if found is None:
            break
        accepted.append(found[0])
        now = objective.reference(found[1].hypothesis)
        parts = range(len(accepted))
        (now,) = refine(objective, [now.hypothesis], [parts], iterations=3)
        now = objective.reference(now.hypothesis)
        accepted, now = _prune(objective, accepted, now)
    final = tuple(
        Accepted(p, a.shape, a.gain, a.rivals)
        for a, p in zip(accepted, now.hypothesis, strict=True)
    )
    return Outcome(final, now, nominal, tuple(considered))


def _best_addition(
    screen: Screen,
    objective: Objective,
    now: Assessed,
    accepted: Sequence[Accepted],
    considered: list[Considered],
) -> tuple[Accepted, Assessed] | None:
    ranked = screen.rank([(a.planted, a.shape) for a in accepted])
    tried = candidates(screen, ranked, objective, now)
    replayed = {p.key for p, _ in tried}
    considered += [
        Considered(s.planted.effect.id, s.planted.at, s.gain, "screened", "not replayed")
        for s in ranked
        if s.planted.key not in replayed
    ]
    if not tried:
        return None
    starts = _first_of_each(objective, now, [p for p, _ in tried])
    shapes = {p.key: shape for p, shape in tried}
    last = [[len(now.hypothesis)]] * len(starts)
    fits = refine(objective, starts, last, iterations=1)
    fits.sort(key=lambda f: -_worth(objective, f, now))
    promising = [f.hypothesis for f in fits[:_PROMISING]]
    fits = [*refine(objective, promising, last[:_PROMISING], iterations=2), *fits[_PROMISING:]]
    fits.sort(key=lambda f: -_worth(objective, f, now))
    finalists = [f.hypothesis for f in fits[:_FINALISTS]]
    everything = [range(len(now.hypothesis) + 1)] * len(finalists)
    fits = [*refine(objective, finalists, everything, iterations=4), *fits[_FINALISTS:]]
    fits.sort(key=lambda f: -_worth(objective, f, now))
    best = _simplest(objective, fits, now)
    fits = [best, *(f for f in fits if f is not best)]
    ok = _earns(objective, best, now)
    for i, fit in enumerate(fits):
        planted = fit.hypothesis[-1]
        verdict = "accepted" if ok and i == 0 else "gains too little"
        if ok and i > 0:
            verdict = f"beaten by {best.hypothesis[-1]}"
        worth = _worth(objective, fit, now)
        considered.append(Considered(planted.effect.id, planted.at, worth, "replayed", verdict))
    if not ok:
        return None
    rivals = tuple(
        Rival(f.hypothesis[-1], f.loglik - best.loglik)
        for f in fits[1:]
        if _worth(objective, f, now) > _worth(objective, best, now) - EQUIVALENT_NATS
    )
    planted = best.hypothesis[-1]
    gain = _worth(objective, best, now)
    return Accepted(planted, shapes.get(planted.key), gain, rivals), best


def _first_of_each(
    objective: Objective, now: Assessed, additions: Sequence[Planted]
) -> list[Hypothesis]:
    """One start for each effect and place, the best of those that are given, and only the best."""
    found: dict[tuple[str, str, str], Assessed] = {}
    for assessed in evaluate(objective, [(*now.hypothesis, p) for p in additions]):
        key = assessed.hypothesis[-1].key
        if key not in found or assessed.loglik > found[key].loglik:
            found[key] = assessed
    # a start may be far off and its effect still right: a few that are worse than nothing stay
    ordered = sorted(found.values(), key=lambda a: -a.loglik)
    return [a.hypothesis for a in ordered[:_STARTS] if np.isfinite(a.loglik)]


def _simplest(objective: Objective, fits: Sequence[Assessed], now: Assessed) -> Assessed:
    """The best fit, or one as good as it with fewer parameters.

    A law that contains another (load-dependent friction and Coulomb's) always fits a little
    better; it has to earn its further parameters as any effect has.
    """
    top = _worth(objective, fits[0], now)
    close = [f for f in fits if _worth(objective, f, now) > top - MIN_NATS]
    fewest = min(f.hypothesis[-1].effect.n_theta for f in close)
    return next(f for f in close if f.hypothesis[-1].effect.n_theta == fewest)


def _price(objective: Objective, hypothesis: Hypothesis) -> float:
    """Half a log of the sample count for each parameter (Schwarz, 1978), and prior odds."""
    parameters = sum(p.effect.n_theta for p in hypothesis)
    odds = sum(p.effect.odds_against for p in hypothesis)
    return odds + 0.5 * parameters * float(np.log(max(objective.count.sum(), 2.0)))


def _worth(objective: Objective, fit: Assessed, now: Assessed) -> float:
    """Nats gained by a hypothesis over the present one, after the price of its parameters."""
    if not all(p.effect.plausible(p.at, p.theta) for p in fit.hypothesis):
        return -np.inf
    price = _price(objective, fit.hypothesis) - _price(objective, now.hypothesis)
    return fit.loglik - now.loglik - price


def _earns(objective: Objective, fit: Assessed, now: Assessed) -> bool:
    drop = 1.0 - fit.mse / now.mse
    return _worth(objective, fit, now) > MIN_NATS and bool((drop > MIN_DROP).any())


def _prune(
    objective: Objective, accepted: list[Accepted], now: Assessed
) -> tuple[list[Accepted], Assessed]:
    """Drop effects that the later ones made superfluous."""
    while len(accepted) > 1:
        without = [
            tuple(p for k, p in enumerate(now.hypothesis) if k != i) for i in range(len(accepted))
        ]
        fits = refine(objective, without, [range(len(accepted) - 1)] * len(without), iterations=2)
        losses = [_worth(objective, now, fit) for fit in fits]
        weakest = int(np.argmin(losses))
        if losses[weakest] > MIN_NATS and _earns(objective, now, fits[weakest]):
            break
        accepted = [a for i, a in enumerate(accepted) if i != weakest]
        now = objective.reference(fits[weakest].hypothesis)
    return accepted, now
