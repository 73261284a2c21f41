"""Events: what happens to a machine at moments that no other recording has, such as pushes.

Nothing that was fitted elsewhere predicts an event, so that held-out recordings prove none. Each is
its own proof. It must stand out of all that models are usually off by, in recordings as a whole
(:class:`~wt.physics.hooks.Evident`), and replays of half a second, which start before it and run
on from it, must be ahead with it: they measure positions alone and know nothing of that force.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import erfc

from wt.diagnose.likelihood.moments import windows
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.result import Estimate
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import Gain
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.hooks import Evident
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis, Planted, without
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.physics.usual import MOMENT_S


@dataclass(frozen=True, eq=False)
class Event:
    """Events of one kind at one place, in all recordings.

    Attributes:
        planted: acts in replays like any other effect.
        estimates: its parameters by name.
        gain: share of the squared error of all recordings that they remove, and how probable it is
            that as many moments of usual errors hold one of them.
    """

    planted: Planted
    estimates: dict[str, Estimate]
    gain: Gain


def events(
    motion: Motion, replays: Callable[[], Objective], known: Hypothesis, log: DecisionLog
) -> tuple[Event, ...]:
    """Events that all recordings of a machine show beside what is known.

    Their sizes are those of the force: replays of a model that still errs elsewhere know them less.

    Args:
        motion: all recordings, the held-out ones among them.
        replays: makes replays of the same, once something stands out.
        known: effects that were found.
        log: grows by every decision.
    """
    found = _standing_out(motion, known)
    if not found:
        return ()
    objective = replays()
    found = _proven(objective, known, found, log)
    moments = len(motion) * motion.dt / MOMENT_S * motion.q.shape[1]
    chance = float(min(1.0, moments * erfc(Evident.DEVIATIONS / np.sqrt(2.0))))
    while found:
        hypothesis = (*known, *(f.planted for f in found))
        lesser = [without(hypothesis, i) for i in range(len(known), len(hypothesis))]
        after, *before = [
            float((objective.left(a) ** 2).sum()) for a in objective.evaluate([hypothesis, *lesser])
        ]
        gains = [Gain(max(1.0 - after / b, 0.0), chance) for b in before]
        weakest = int(np.argmin([g.share for g in gains]))
        share, least = gains[weakest].share, THRESHOLDS.momentary_share
        if share >= least:
            break
        reason = "whatever it is, its moments explain little of the errors"
        log.add(found[weakest].planted, "event", False, share, least, reason)
        # what made up for it is not needed any more
        rest = [f for i, f in enumerate(found) if i != weakest]
        found = _proven(objective, known, rest, log)
    proven = []
    for f, gain in zip(found, gains if found else (), strict=True):
        reason = "stands out of what models are usually off by, and replays are ahead with it"
        log.add(f.planted, "event", True, chance, THRESHOLDS.significant, reason)
        proven.append(Event(f.planted, _estimates(objective.scene, f), gain))
    return tuple(proven)


class _Found(NamedTuple):
    """Events of one kind at one place, and half widths of their sizes' 95 % intervals."""

    planted: Planted
    spread: Float[np.ndarray, " event"]

    def less(self, events: Sequence[int]) -> _Found:
        """The same without some of them."""
        kept = ~np.isin(np.arange(len(self.spread)), events)
        assert isinstance(self.planted.effect, Evident)
        effect, theta = self.planted.effect.only(self.planted.theta, kept)
        return _Found(replace(self.planted, effect=effect, theta=theta), self.spread[kept])

    @property
    def moments(self) -> list[tuple[float, float, float]]:
        """Recording, start and end of each event."""
        known = self.planted.observed()
        ends = np.reshape(known["windows"][1], (-1, 2)).tolist()
        return [(r, *pair) for r, pair in zip(known["recordings"][1], ends, strict=True)]


def _estimates(scene: Scene, found: _Found) -> dict[str, Estimate]:
    """Parameters by name."""
    planted, units = found.planted, units_at(scene, found.planted.at)
    (size,) = planted.effect.parameters
    low, value, high = (
        tuple((planted.theta + sign * found.spread).tolist()) for sign in (-1, 0, 1)
    )
    estimates = {size.name: Estimate(value, size.unit_in(units), (low, high))}
    for name, (unit, values) in planted.observed().items():
        estimates[name] = Estimate(values, units.of(unit), (values, values))
    return estimates


def _standing_out(motion: Motion, known: Hypothesis) -> list[_Found]:
    """Events of other kinds and places than what is known.

    They are read off the whole residual. What is known may be wrong, and taking a wrong force out
    of it leaves events; a right one that the model lacks makes them stand out less.
    """
    taken, found = {p.key for p in known}, list[_Found]()
    for effect in effects().values():
        if not isinstance(effect, Evident):
            continue
        for at in effect.places(motion.scene):
            shown = effect.evident(motion, at)
            if shown is not None and (effect.id, at.kind, at.name) not in taken:
                found.append(_Found(Planted(shown[0], at, shown[1]), shown[2]))
    return found


def _proven(
    objective: Objective, known: Hypothesis, found: list[_Found], log: DecisionLog
) -> list[_Found]:
    """Those events with which replays are ahead: the one that they need least leaves first.

    Some at one moment, at several joints, may be needed for nothing but to make up for each other:
    they leave together.
    """
    while found:
        # tolerances had made up for the events, and no longer need to
        full = objective.reference((*known, *(f.planted for f in found)))
        each = [[(i, k)] for i, f in enumerate(found) for k in range(len(f.spread))]
        for groups in filter(None, (each, _at_once(found))):
            options = [_less(found, group) for group in groups]
            lesser = objective.evaluate([(*known, *(f.planted for f in o)) for o in options])
            leads = _leads(objective, full, lesser)
            weakest = int(np.argmin(leads))
            if leads[weakest] <= THRESHOLDS.equivalent_nats:
                break
        else:
            break
        reason, least = "replays are not ahead with one of its events", THRESHOLDS.equivalent_nats
        for i in dict.fromkeys(i for i, _ in groups[weakest]):
            log.add(found[i].planted, "event", False, leads[weakest], least, reason)
        found = options[weakest]
    return found


def _at_once(found: Sequence[_Found]) -> list[list[tuple[int, int]]]:
    """Events at one moment of a recording, each as indices of a kind and of an event."""
    each = [(*m, (i, k)) for i, f in enumerate(found) for k, m in enumerate(f.moments)]
    groups: list[list[tuple[int, int]]] = []
    last, until = -1.0, -np.inf
    for recording, start, end, event in sorted(each):
        if recording == last and start <= until:
            groups[-1].append(event)
        else:
            groups.append([event])
            until = -np.inf
        last, until = recording, max(until, end)
    return [group for group in groups if len(group) > 1]


def _less(found: Sequence[_Found], events: Sequence[tuple[int, int]]) -> list[_Found]:
    """The same without some events, each an index of a kind and one of an event."""
    rest = []
    for i, f in enumerate(found):
        gone = [k for kind, k in events if kind == i]
        if len(gone) < len(f.spread):
            rest.append(f.less(gone) if gone else f)
    return rest


def _leads(objective: Objective, full: Assessed, lesser: Sequence[Assessed]) -> list[float]:
    """Nats by which a hypothesis is ahead of lesser ones, in each window by its own error.

    An event shows for half a second. In all of a recording, whose errors are large where replays
    part from it, it would drown.
    """
    sides = [_nats(objective, a) for a in (full, *lesser)]
    return [float((sides[0] - other).sum()) for other in sides[1:]]


def _nats(objective: Objective, assessed: Assessed) -> Float[np.ndarray, " window"]:
    """Log-likelihood of each window, whose errors have a variance of their own."""
    window = windows(objective)
    valid, count = objective.channels.valid, int(window.max()) + 1
    sums, samples = np.zeros((2, count, valid.shape[1]))
    np.add.at(sums, window, np.where(valid, objective.left(assessed) ** 2, 0.0))
    np.add.at(samples, window, valid.astype(float))
    mse = sums / np.maximum(samples, 1.0) + objective.floor**2
    independent = samples * THRESHOLDS.independent_hz * float(np.median(np.diff(objective.t)))
    return np.asarray(-0.5 * (independent * np.log(mse)).sum(axis=1))
