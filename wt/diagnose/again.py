"""The same effects on other recordings: named on some, estimated on each.

A diagnosis says which effects its own recordings show. To compare machines, or days of one, each
must say how large the *same* effects are, also where they are small. ``named`` searches, as a
diagnosis does, ``estimated`` fits a hypothesis that is given, with the same intervals, and ``left``
says what one that is not fitted leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from wt.diagnose.effort import effort_of
from wt.diagnose.likelihood.bic import worth
from wt.diagnose.likelihood.estimate import estimate, fitted
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.sets import objective_on
from wt.diagnose.pace import Pace, Say
from wt.diagnose.pipeline import audited, searched
from wt.diagnose.recordings.commands import smooth_as_sent
from wt.diagnose.recordings.prepare import Prepared, Source
from wt.diagnose.recordings.stretches import longest_window
from wt.diagnose.result import Estimate
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import errors, prepare_holdout
from wt.diagnose.split import steps_for
from wt.errors import RecordingError
from wt.physics.planted import Hypothesis, Planted
from wt.physics.quiet import quiet
from wt.physics.scene import Scene


@dataclass(frozen=True, eq=False)
class Recorded:
    """Recordings of one machine under one state, audited.

    Attributes:
        scene: the model, with what the audit corrected in it.
        prepared: the recordings, corrected likewise.
    """

    scene: Scene
    prepared: Prepared


def recorded(model: str | Path, recordings: Sequence[Source]) -> Recorded:
    """Read and audit recordings.

    Raises:
        ModelError: the MJCF cannot be used.
        RecordingError: a recording cannot be used, or its commands are not those that were sent.
    """
    scene, prepared = audited(model, recordings, (), Pace(None, None))
    for finding in prepared.audit:
        if finding.voids_commands:
            raise RecordingError(f"{finding.evidence}; {finding.fix}")
    return Recorded(scene, prepared)


@quiet()
def named(of: Recorded, seed: int = 0, progress: Say | None = None) -> Hypothesis:
    """Effects that these recordings show, with their parameters.

    What happened at moments of its own, and laws that have no name, are not among them.

    Args:
        of: the recordings.
        seed: of everything random.
        progress: called as the work goes on.
    """
    pace = Pace(progress, None)
    claims = searched(of.scene, of.prepared, seed, DecisionLog(), pace).claims
    return tuple(p for p in claims.estimated.hypothesis if not p.observed())


@quiet()
def estimated(
    of: Recorded, hypothesis: Hypothesis
) -> tuple[tuple[Planted, dict[str, Estimate]], ...]:
    """Fit given effects together on all of some recordings.

    Args:
        of: the recordings.
        hypothesis: effects, with parameters to start from.

    Returns:
        Each effect as fitted with its parameters by name, in the given order; an effect that the
        recordings contradict is left out.
    """
    objective, start = _possible(of, hypothesis)
    found = estimate(objective, start)
    return tuple(zip(found.hypothesis, found.estimates, strict=True))


@quiet()
def worth_of(of: Recorded, hypothesis: Hypothesis, planted: Planted) -> float:
    """What some recordings lose with one of several effects [nats], less its parameters' price.

    The others are fitted with it and without it.

    Args:
        of: the recordings.
        hypothesis: effects, with parameters to start from.
        planted: one of them; worth −∞ if the recordings contradict it.
    """
    objective, start = _possible(of, hypothesis)
    if planted.key not in (p.key for p in start):
        return -np.inf
    whole = fitted(objective, start)
    rest = tuple(p for p in whole.hypothesis if p.key != planted.key)
    return worth(objective, whole, fitted(objective, rest))


def _possible(of: Recorded, hypothesis: Hypothesis) -> tuple[Objective, Hypothesis]:
    """Replays of all of some recordings, and the effects that these do not contradict."""
    scene, effort = of.scene, effort_of(of.scene)
    whole, forgetting = smooth_as_sent(scene, of.prepared.whole, effort.step, effort.search_step)
    window = None if forgetting or scene.free else longest_window(whole, effort.search_step)
    smooth = steps_for([whole], window)
    objective = objective_on([whole], forgetting, effort.most_s, effort.step, window, smooth)
    here = [p.elsewhere(whole.motion) for p in hypothesis]
    return objective, tuple(p for p in here if p.wrong(whole.motion) is None)


@dataclass(frozen=True, eq=False)
class Left:
    """What replays of a machine leave of recordings, in blocks of up to a second.

    Attributes:
        joints: names.
        error: RMS of what is left [rad or m].
        low, high: where each joint was, from and to [rad or m].
    """

    joints: tuple[str, ...]
    error: Float[np.ndarray, "block joint"]
    low: Float[np.ndarray, "block joint"]
    high: Float[np.ndarray, "block joint"]


@quiet()
def left(of: Recorded, hypothesis: Hypothesis) -> Left:
    """What given effects, as they are, leave of recordings.

    Args:
        of: the recordings.
        hypothesis: effects with their parameters.
    """
    scene, effort = of.scene, effort_of(of.scene)
    whole, forgetting = smooth_as_sent(scene, of.prepared.whole, effort.step, effort.search_step)
    window = None if forgetting or scene.free else longest_window(whole, effort.search_step)
    replayed = prepare_holdout(whole, forgetting, window=window)
    here = tuple(p.elsewhere(whole.motion) for p in hypothesis)
    joints = tuple(scene.own_joints)
    dofs = [scene.dof(name) for name in joints]
    off, measured = errors(replayed, [here], effort.step)[0][:, dofs], replayed.measured[:, dofs]
    blocks = [np.flatnonzero(replayed.block == b) for b in np.unique(replayed.block)]
    seen = [b for b in blocks if np.isfinite(off[b]).any(axis=0).all()]
    return Left(
        joints,
        np.array([np.sqrt(np.nanmean(off[b] ** 2, axis=0)) for b in seen]),
        np.array([np.nanmin(measured[b], axis=0) for b in seen]),
        np.array([np.nanmax(measured[b], axis=0) for b in seen]),
    )
