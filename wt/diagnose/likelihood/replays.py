"""Replays at coarse steps that do for fine ones, and their finite differences.

:class:`Extrapolated` replays at coarse steps and corrects them by what fine ones change at a
reference. :class:`Nearby` is linear around a hypothesis: the changes of its replays by the model's
tolerances and by other initial states.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.likelihood.adapt import responses
from wt.diagnose.likelihood.steps import COARSE, Accuracy, Steps, probes_of
from wt.diagnose.likelihood.tolerances import ModelTolerance
from wt.physics.planted import Hypothesis, Key, Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene

_SLOPE_STEP_S = 2e-3
"""Physics step for small differences between replays, unless coarse ones are longer [s]."""
_BOUNDED = 0.02
"""Most that coarse steps may change, as a share of how far a joint moves; beyond, finer ones do."""


class Extrapolated:
    """Replays of stretches at coarse steps, plus what finer ones change at a reference.

    The steps' error is of first order, so that two step lengths tell what is left at none
    (Richardson's extrapolation). It hardly changes between hypotheses that are close.

    Attributes:
        coarse: takes the long steps.
        slopes: takes steps that do for differences between hypotheses.
        correction: what is added to the positions it says.
        reference: what that is of; None to begin with.
    """

    def __init__(self, scene: Scene, stretches: Sequence[Stretch], steps: Steps) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            steps: fine and coarse.
        """
        self._fine = Replayer(scene, stretches, steps.fine)
        short = self._fine.run([()]).q[0]
        bound = _BOUNDED * np.std(short, axis=0)

        def bounded(longer: float, otherwise: Replayer) -> Replayer:
            replayer = Replayer(scene, stretches, longer)
            apart = np.sqrt(np.mean((replayer.run([()]).q[0] - short) ** 2, axis=0))
            return replayer if (apart <= bound).all() else otherwise  # NaN is none

        self._double = self.coarse = bounded(COARSE * steps.fine, self._fine)
        if self.coarse.step < steps.coarse:
            self.coarse = bounded(steps.coarse, self.coarse)
        self.slopes = self.coarse
        if self.coarse.step < _SLOPE_STEP_S:
            self.slopes = bounded(_SLOPE_STEP_S, self.coarse)
        self._half = Replayer(scene, stretches, 0.5 * steps.fine)
        self.correction = np.zeros_like(short)
        self.reference: Sequence[Planted] | None = None

    def run(
        self, hypotheses: Sequence[Sequence[Planted]]
    ) -> Float[np.ndarray, "hypothesis sample dof"]:
        """Positions; NaN where a replay exploded."""
        return self.coarse.run(hypotheses).q + self.correction

    def around(
        self, reference: Sequence[Planted], near: Sequence[Sequence[Planted]]
    ) -> tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, "hypothesis sample dof"]]:
        """Replay a reference and what is near it; the reference's correction is everybody's now.

        Returns:
            (positions of the reference; what is different near it).
        """
        self.reference = reference
        base, *others = self.slopes.run([reference, *near]).q
        q = base if self.slopes is self.coarse else self.coarse.run([reference]).q[0]
        if self.coarse is not self._fine:
            double = q if self._double is self.coarse else self._double.run([reference]).q[0]
            exact = 2.0 * self._fine.run([reference]).q[0] - double
            self.correction = np.nan_to_num(exact - q)
        return q + self.correction, np.array(others).reshape(-1, *base.shape) - base

    def unsettled(self, reference: Sequence[Planted]) -> Float[np.ndarray, "sample dof"]:
        """What steps half as long still change at a reference, which :meth:`around` was of."""
        (finer,), (fine,) = self._half.run([reference]).q, self._fine.run([reference]).q
        if self.coarse is self._fine:  # nothing is extrapolated: as much again is left
            return np.nan_to_num(2.0 * (finer - fine))
        return np.nan_to_num(2.0 * finer - fine - self.run([reference])[0])

    def lengthened(
        self, probes: Sequence[Hypothesis], accuracy: Accuracy, longest: Replayer
    ) -> Extrapolated:
        """The same with coarse steps as long as they tell some hypotheses apart.

        Args:
            probes: a hypothesis, and some around it.
            accuracy: what coarse steps may be off by.
            longest: takes steps that are not to be exceeded.
        """
        other, longer = copy.copy(self), longest
        other.reference = None  # what it says is not corrected by other steps' errors
        if longer.step > self.coarse.step:
            q, scene, stretches = self.coarse.run(probes).q, longest.scene, longest.stretches
            while longer.step > other.coarse.step:
                if accuracy.apart(longer.run(probes).q, q):
                    other.coarse = longer
                else:
                    longer = Replayer(scene, stretches, 0.5 * longer.step)
        other.slopes = max(other.slopes, other.coarse, key=lambda replayer: replayer.step)
        return other


class Replays:
    """Extrapolated replays of hypotheses, those with a stiff law apart from the rest.

    Their steps may be shorter: as long as references with the same stiff laws allow. Where nothing
    holds the base, what feet meet is as stiff as any.
    """

    def __init__(
        self, scene: Scene, stretches: Sequence[Stretch], step: float, smooth: Steps
    ) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            step: fine step where a law is stiff [s].
            smooth: steps where none is.
        """
        self._scene, self._stretches, self._step = scene, stretches, step
        self._smooth, self._accuracy = Extrapolated(scene, stretches, smooth), smooth.accuracy
        # what steps do to a gear is no correction of what they do without one
        self._stiff = self._smooth if scene.free else None
        self._longer: dict[frozenset[Key], tuple[Hypothesis, Extrapolated]] = {}
        self._reference: Sequence[Planted] = ()

    def of(self, hypothesis: Sequence[Planted]) -> Extrapolated:
        """The replays that a hypothesis takes."""
        stiff = _stiff_of(hypothesis)
        if not stiff:
            return self._smooth
        if (known := self._longer.get(_keys(stiff))) is not None:
            return known[1]
        if self._stiff is None:
            steps = Steps.usual(self._step)
            self._stiff = Extrapolated(self._scene, self._stretches, steps)
        return self._stiff

    def run(
        self, hypotheses: Sequence[Sequence[Planted]]
    ) -> Float[np.ndarray, "hypothesis sample dof"]:
        """Positions; NaN where a replay exploded."""
        each = [self.of(h) for h in hypotheses]
        q = np.empty((len(each), *self._smooth.correction.shape))
        for kind in dict.fromkeys(each):
            rows = [i for i, other in enumerate(each) if other is kind]
            self._settle(kind)
            q[rows] = kind.run([hypotheses[i] for i in rows])
        return q

    def around(
        self, reference: Sequence[Planted], near: Sequence[Sequence[Planted]]
    ) -> tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, "hypothesis sample dof"]]:
        """See :meth:`Extrapolated.around`."""
        self._lengthen(reference)
        self._reference = reference
        return self.of(reference).around(reference, near)

    def apart(self) -> Replays:
        """The same with corrections of their own."""
        other = copy.copy(self)
        other._smooth = copy.copy(self._smooth)
        if self._stiff is not None:
            one = self._stiff is self._smooth
            other._stiff = other._smooth if one else copy.copy(self._stiff)
        other._longer = {k: (h, copy.copy(longer)) for k, (h, longer) in self._longer.items()}
        return other

    def _lengthen(self, reference: Sequence[Planted]) -> None:
        """Find the steps for a reference with stiff laws, unless it is like the last with these."""
        stiff, motion = _stiff_of(reference), self._stretches[0].motion
        if not stiff or self._accuracy is None or motion is None:
            return
        known = self._longer.pop(_keys(stiff), None)
        if known is None or not like(known[0], stiff):
            probes, longest = probes_of(stiff, motion), self._smooth.coarse
            known = stiff, self.of(stiff).lengthened(probes, self._accuracy, longest)
        self._longer[_keys(stiff)] = known

    def _settle(self, kind: Extrapolated) -> None:
        """Correct others than the reference's by it, or by what of it they can follow."""
        if kind is self.of(self._reference):
            return
        smooth = kind is self._smooth
        followed = [p for p in self._reference if not (smooth and p.effect.stiff)]
        if kind.reference is None or list(kind.reference) != followed:
            kind.around(followed, [])


def like(one: Sequence[Planted], other: Sequence[Planted]) -> bool:
    """Whether two hypotheses are the same effects with parameters that are close."""
    if [p.key for p in one] != [p.key for p in other]:
        return False
    sizes = [(p.theta, q.theta) for p, q in zip(one, other, strict=True)]
    if any(len(a) != len(b) for a, b in sizes):
        return False  # laws of one place differ in their number of terms
    return all(np.linalg.norm(b - a) <= _CLOSE * np.linalg.norm(a) for a, b in sizes)


def _but_one(one: Sequence[Planted], other: Sequence[Planted]) -> bool:
    """Whether two hypotheses are alike but for one effect that only one of them has."""
    smaller, larger = sorted((one, other), key=len)
    if len(larger) - len(smaller) != 1:
        return False
    return any(like(smaller, [*larger[:i], *larger[i + 1 :]]) for i in range(len(larger)))


def _stiff_of(hypothesis: Sequence[Planted]) -> tuple[Planted, ...]:
    return tuple(p for p in hypothesis if p.effect.stiff)


def _keys(hypothesis: Sequence[Planted]) -> frozenset[Key]:
    return frozenset(p.key for p in hypothesis)


DEVIATION = 0.1
"""Change of an error for its derivative [deviations]: long valleys need good ones."""
ROUGH = 10.0
"""Factor by which differences are larger on legs: a foot lands a physics step earlier or later
after the smallest change, and what that does must not pass for a slope."""


_CLOSE = 0.3
"""Parameters of a hypothesis are close to another's within such a share of theirs."""
_KEPT, _LEAST, _BYTES = 12, 4, 2**27
"""Hypotheses whose differences are kept, as a search comes back to where it was: fewer where these
would take more memory, or no replay says whether they will do, but so many at least."""


class _Changes(NamedTuple):
    """What is different near a hypothesis, see :meth:`Nearby.around`."""

    hypothesis: tuple[Planted, ...]
    of_tolerances: Float[np.ndarray, "tolerance sample dof"]
    of_states: Float[np.ndarray, "sample dof state"]


class Nearby:
    """Finite differences of replays, by which they are linear around a hypothesis.

    A floating base has many links and as many unknown initial speeds; what they change is computed
    once there for hypotheses of the same effects, whatever their parameters. Where drives hold a
    machine, so that it forgets how it began, they are taken over from one of close parameters, for
    a replay to say whether they will do.

    Attributes:
        nudge: factor by which differences are larger than where replays are smooth.
        tolerances: of the model.
        able: which of them a model can hold.
    """

    def __init__(
        self,
        replays: Replays,
        tolerances: Sequence[ModelTolerance],
        once: bool,
        remembers: bool,
    ) -> None:
        """Prepare.

        Args:
            replays: of the stretches.
            tolerances: of the model.
            once: whether to compute what changes once for the same effects.
            remembers: whether the machine does not forget its initial state.
        """
        self._replays, self._once, self._remembers = replays, once, remembers
        self.nudge = ROUGH if once else 1.0
        self._step = DEVIATION * self.nudge
        self.tolerances = tuple(tolerances)
        able = [tolerance.effect.correctable for tolerance in tolerances]
        self.able: Bool[np.ndarray, " tolerance"] = np.array(able, dtype=bool)
        self._correctable = able
        self._known: list[_Changes] = []

    def on(self, replays: Replays) -> Nearby:
        """The same differences of other replays of the same stretches."""
        other = copy.copy(self)
        other._replays = replays
        return other

    def rig(self, sizes: Float[np.ndarray, " tolerance"]) -> tuple[Planted, ...]:
        """Tolerances of such sizes [deviations], those that a model can hold."""
        pairs = enumerate(sizes.tolist())
        return tuple(self._scaled(i, x) for i, x in pairs if x and self._correctable[i])

    @functools.lru_cache(maxsize=2**14)  # noqa: B019 – lives and dies with a diagnosis
    def _scaled(self, index: int, size: float) -> Planted:
        """One tolerance of such a size: of many rigs the same one, which is then known again."""
        return self.tolerances[index].scaled(size)

    def around(
        self,
        hypothesis: Sequence[Planted],
        centre: Float[np.ndarray, " tolerance"],
        anew: bool = False,
    ) -> tuple[
        Float[np.ndarray, "sample dof"],
        Float[np.ndarray, "tolerance sample dof"],
        Float[np.ndarray, "sample dof state"],
    ]:
        """Replay a hypothesis with the tolerances at ``centre`` [deviations].

        Args:
            hypothesis: what to replay.
            centre: where the tolerances are.
            anew: whether what those of a hypothesis close by changed will not do.

        Returns:
            (positions; what changes per deviation of each tolerance; what changes per deviation
            of each initial state, of no width if it is forgotten).
        """
        here = (*hypothesis, *self.rig(centre))
        taken = self._taken(hypothesis)
        if taken and not (anew and not self._once):
            return self._replays.around(here, [])[0], *taken[1:]
        moved = [
            (*hypothesis, *self.rig(centre + one)) if t.effect.correctable else (*here, t.planted)
            for t, one in zip(self.tolerances, self._step * np.eye(len(centre)), strict=True)
        ]
        q, changes = self._replays.around(here, moved)
        changes = np.nan_to_num(changes) / np.where(self.able, self._step, 1.0)[:, None, None]
        response = np.zeros((*q.shape, 0))
        if self._remembers:
            response = responses(self._replays.of(here).slopes, here)
        self._keep(_Changes(tuple(hypothesis), changes, response))
        return q, changes, response

    def lent(self, hypothesis: Sequence[Planted], other: Sequence[Planted]) -> bool:
        """Take what another's tolerances change for a hypothesis's of which nothing is known.

        Only where drives hold a machine, and for a replay to say whether it will do.

        Returns:
            Whether anything is known of the other, and was taken.
        """
        if self._once or self._remembers or self._taken(hypothesis):
            return False
        close = [k for k in self._known if self._close(k.hypothesis, other)]
        for known in close[-1:]:
            self._keep(known._replace(hypothesis=tuple(hypothesis)))
        return bool(close)

    def _keep(self, changes: _Changes) -> None:
        """Remember what is different near a hypothesis, in place of what was close to it."""
        kept = [k for k in self._known if not self._close(k.hypothesis, changes.hypothesis)]
        room = 0 if self._once else _BYTES // (changes.of_tolerances.nbytes + 1)
        most = min(_KEPT, max(_LEAST, room))
        self._known = [*kept[1 - most :], changes]

    def _taken(self, hypothesis: Sequence[Planted]) -> _Changes | None:
        """What is known of one close by.

        Or, where drives hold a machine, of one with an effect less or more: what that adds to a
        motion hardly changes what the tolerances do.
        """
        close = [k for k in self._known if self._close(k.hypothesis, hypothesis)]
        if not close and not self._remembers:
            close = [k for k in self._known if _but_one(k.hypothesis, hypothesis)]
        return close[-1] if close else None

    def _close(self, one: Sequence[Planted], other: Sequence[Planted]) -> bool:
        """Whether what one's tolerances change will do for the other's."""
        if self._once:
            return [p.key for p in one] == [p.key for p in other]
        return not self._remembers and like(one, other)
