"""Replays at coarse steps that do for fine ones, and their finite differences.

:class:`Extrapolated` replays at coarse steps and corrects them by what fine ones change at a
reference. :class:`Nearby` is linear around a hypothesis: the changes of its replays by the model's
tolerances and by other initial states.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.likelihood.adapt import responses
from wt.diagnose.likelihood.tolerances import ModelTolerance
from wt.diagnose.recordings.smooth import Smoothed
from wt.physics.effect import effects
from wt.physics.planted import Key, Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

COARSE = 2.0
"""Physics step of most replays, in fine ones; the extrapolation needs two."""
_SLOPE_STEP_S = 2e-3
"""Physics step for small differences between replays, unless coarse ones are longer [s]."""
_BOUNDED = 0.02
"""Most that coarse steps may change, as a share of how far a joint moves; beyond, fine ones do."""
_EXACT, _RUBBING = 0.15, 0.05
"""What longer steps may still be off by, in noise, with friction of such a share of all force."""


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

    def __init__(self, scene: Scene, stretches: Sequence[Stretch], step: float) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            step: the fine step [s].
        """
        self._fine = Replayer(scene, stretches, step)
        short = self._fine.run([()]).q[0]
        bound = _BOUNDED * np.std(short, axis=0)

        def bounded(longer: float, otherwise: Replayer) -> Replayer:
            replayer = Replayer(scene, stretches, longer)
            apart = np.sqrt(np.mean((replayer.run([()]).q[0] - short) ** 2, axis=0))
            return replayer if (apart <= bound).all() else otherwise  # NaN is none

        self.coarse = bounded(COARSE * step, self._fine)
        self.slopes = self.coarse
        if self.coarse.step < _SLOPE_STEP_S:
            self.slopes = bounded(_SLOPE_STEP_S, self.coarse)
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
            self.correction = np.nan_to_num(2.0 * (self._fine.run([reference]).q[0] - q))
        return q + self.correction, np.array(others).reshape(-1, *base.shape) - base

    def unsettled(self, reference: Sequence[Planted]) -> Float[np.ndarray, "sample dof"]:
        """What steps half as long still change at a reference, which :meth:`around` was of."""
        half = Replayer(self._fine.scene, self._fine.stretches, 0.5 * self._fine.step)
        (finer,), (fine,) = half.run([reference]).q, self._fine.run([reference]).q
        if self.coarse is self._fine:  # nothing is extrapolated: as much again is left
            return np.nan_to_num(2.0 * (finer - fine))
        return np.nan_to_num(2.0 * finer - fine - self.run([reference])[0])


def longest_step(smoothed: Smoothed, stretches: Sequence[Stretch], step: float) -> float:
    """The longest step whose extrapolated replays say what finer ones do [s].

    By no more than a share of the noise, with dry friction in every joint: what sticks and slips
    follows no order in the steps. The given one, twice that and so on, up to the model's own.

    Args:
        smoothed: the recordings.
        stretches: of them.
        step: the shortest [s].
    """
    motion, scene = smoothed.motion, smoothed.motion.scene
    size = _RUBBING * np.sqrt(np.mean(motion.demand**2, axis=0))
    rubbing = [
        Planted(effects()["joint.friction_coulomb"], Location("joint", j), size[[scene.dof(j)]])
        for j in scene.own_joints
    ]

    @functools.cache
    def replayed(long: float) -> Float[np.ndarray, "sample dof"]:
        return Replayer(scene, stretches, long).run([rubbing]).q[0]

    while 2.0 * step <= scene.model.opt.timestep:
        finer, longer = (2.0 * replayed(h) - replayed(COARSE * h) for h in (step, 2.0 * step))
        off = np.sqrt(np.mean((longer - finer) ** 2, axis=0))
        if not (off <= _EXACT * np.nan_to_num(smoothed.noise, nan=np.inf)).all():
            break
        step *= 2.0
    return step


class Replays:
    """Extrapolated replays of hypotheses, those with a stiff law apart from the rest.

    Their steps may be shorter. Where nothing holds the base, what feet meet is as stiff as any.
    """

    def __init__(
        self, scene: Scene, stretches: Sequence[Stretch], step: float, smooth: float
    ) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            step: fine step where a law is stiff [s].
            smooth: … and where none is.
        """
        self._scene, self._stretches, self._step = scene, stretches, step
        self._smooth = Extrapolated(scene, stretches, smooth)
        # what steps do to a gear is no correction of what they do without one
        self._stiff = self._smooth if scene.free else None
        self._reference: Sequence[Planted] = ()

    def of(self, hypothesis: Sequence[Planted]) -> Extrapolated:
        """The replays that a hypothesis takes."""
        if not any(p.effect.stiff for p in hypothesis):
            return self._smooth
        if self._stiff is None:
            self._stiff = Extrapolated(self._scene, self._stretches, self._step)
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
        self._reference = reference
        return self.of(reference).around(reference, near)

    def apart(self) -> Replays:
        """The same with corrections of their own."""
        other = copy.copy(self)
        other._smooth = copy.copy(self._smooth)
        if self._stiff is not None:
            one = self._stiff is self._smooth
            other._stiff = other._smooth if one else copy.copy(self._stiff)
        return other

    def _settle(self, kind: Extrapolated) -> None:
        """Correct others than the reference's by it, or by what of it they can follow."""
        if kind is self.of(self._reference):
            return
        smooth = kind is self._smooth
        followed = [p for p in self._reference if not (smooth and p.effect.stiff)]
        if kind.reference is None or list(kind.reference) != followed:
            kind.around(followed, [])


_STEP = 0.1
"""Change of an error for its derivative [deviations]: long valleys need good ones."""
ROUGH = 10.0
"""Factor by which differences are larger on legs: a foot lands a physics step earlier or later
after the smallest change, and what that does must not pass for a slope."""


class Nearby:
    """Finite differences of replays, by which they are linear around a hypothesis.

    A floating base has many links and as many unknown initial speeds; what they change is computed
    once there for hypotheses of the same effects, whatever their parameters.

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
        self._step = _STEP * self.nudge
        self.tolerances = tuple(tolerances)
        able = [tolerance.effect.correctable for tolerance in tolerances]
        self.able: Bool[np.ndarray, " tolerance"] = np.array(able, dtype=bool)
        self._known: (
            tuple[
                tuple[Key, ...],
                Float[np.ndarray, "tolerance sample dof"],
                Float[np.ndarray, "sample dof state"],
            ]
            | None
        ) = None

    def on(self, replays: Replays) -> Nearby:
        """The same differences of other replays of the same stretches."""
        other = copy.copy(self)
        other._replays = replays
        return other

    def rig(self, sizes: Float[np.ndarray, " tolerance"]) -> tuple[Planted, ...]:
        """Tolerances of such sizes [deviations], those that a model can hold."""
        pairs = zip(self.tolerances, sizes, strict=True)
        return tuple(t.scaled(float(x)) for t, x in pairs if t.effect.correctable and x)

    def around(
        self, hypothesis: Sequence[Planted], centre: Float[np.ndarray, " tolerance"]
    ) -> tuple[
        Float[np.ndarray, "sample dof"],
        Float[np.ndarray, "tolerance sample dof"],
        Float[np.ndarray, "sample dof state"],
    ]:
        """Replay a hypothesis with the tolerances at ``centre`` [deviations].

        Returns:
            (positions; what changes per deviation of each tolerance; what changes per deviation
            of each initial state, of no width if it is forgotten).
        """
        here = (*hypothesis, *self.rig(centre))
        keys = tuple(p.key for p in hypothesis)
        if self._known is not None and self._known[0] == keys:
            return self._replays.around(here, [])[0], *self._known[1:]
        moved = [
            (*hypothesis, *self.rig(centre + one)) if t.effect.correctable else (*here, t.planted)
            for t, one in zip(self.tolerances, self._step * np.eye(len(centre)), strict=True)
        ]
        q, changes = self._replays.around(here, moved)
        changes = np.nan_to_num(changes) / np.where(self.able, self._step, 1.0)[:, None, None]
        response = np.zeros((*q.shape, 0))
        if self._remembers:
            response = responses(self._replays.of(here).slopes, here)
        self._known = (keys, changes, response) if self._once else None
        return q, changes, response
