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
from wt.diagnose.likelihood.tolerances import ModelTolerance
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

COARSE = 2.0
"""Physics step of most replays at least, in fine ones; the extrapolation needs two."""
_LONGEST_S = 8e-3
"""Longest physics step of most replays [s]."""
_SLOPE_STEP_S = 2e-3
"""Physics step for small differences between replays, unless coarse ones are longer [s]."""
_BOUNDED = 0.02
"""Most that coarse steps may change, as a share of how far a joint moves; beyond, finer ones do."""
_EXACT, _APART, _PROBED = 0.15, 0.3, 0.05
"""What longer fine steps, and coarse ones, may be off by, in what no law is asked to explain, with
laws of such a share of all force."""


class Steps(NamedTuple):
    """Physics steps of replays [s].

    Attributes:
        fine: of those few that say what a reference does.
        coarse: of those many that say what is different from it.
    """

    fine: float
    coarse: float

    @classmethod
    def usual(cls, fine: float) -> Steps:
        """Those where nothing is known of what longer ones do."""
        return cls(fine, COARSE * fine)

    def at_least(self, fine: float) -> Steps:
        """The same, where none may be shorter than a fine one."""
        fine = max(fine, self.fine)
        return Steps(fine, max(COARSE * fine, self.coarse))


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
        half = Replayer(self._fine.scene, self._fine.stretches, 0.5 * self._fine.step)
        (finer,), (fine,) = half.run([reference]).q, self._fine.run([reference]).q
        if self.coarse is self._fine:  # nothing is extrapolated: as much again is left
            return np.nan_to_num(2.0 * (finer - fine))
        return np.nan_to_num(2.0 * finer - fine - self.run([reference])[0])


def longest_steps(
    smoothed: Smoothed, pairs: Sequence[tuple[Stretch, Float[np.ndarray, "_ dof"]]], step: float
) -> Steps:
    """The longest steps whose replays say what finer ones do, down to a share of the noise.

    Fine ones by themselves, extrapolated, with dry friction in every joint: what sticks and slips
    follows no order in the steps. They are the given one, twice that and so on, up to the model's
    own. Coarse ones by what they say of the difference between hypotheses as far apart as the given
    model is from the recordings, whichever law it lacks.

    Args:
        smoothed: the recordings.
        pairs: stretches of them, each with the measured positions.
        step: the shortest [s].
    """
    motion, scene = smoothed.motion, smoothed.motion.scene
    stretches, measured = [s for s, _ in pairs], np.concatenate([q for _, q in pairs])
    noise = np.nan_to_num(smoothed.noise, nan=np.inf)
    probes = [(), *_probes(motion)]

    @functools.cache
    def replayed(long: float) -> Float[np.ndarray, "probe sample dof"]:
        return Replayer(scene, stretches, long).run(probes).q

    def rms(error: Float[np.ndarray, "*probe sample dof"]) -> Float[np.ndarray, "*probe dof"]:
        return np.asarray(np.sqrt(np.mean(error**2, axis=-2)))

    def extrapolated(long: float) -> Float[np.ndarray, "probe sample dof"]:
        return np.asarray(2.0 * replayed(long) - replayed(COARSE * long))

    fine = step
    while 2.0 * fine <= scene.model.opt.timestep:
        off = rms((extrapolated(2.0 * fine) - extrapolated(fine))[1])
        if not (off <= _EXACT * noise).all():
            break
        fine *= 2.0
    exact = extrapolated(fine)
    moved, coarse = exact[1:] - exact[0], COARSE * fine
    given = np.sqrt(np.nanmean((exact[0] - measured) ** 2, axis=0))
    # what is forgiven to any law is forgiven to steps
    floor = np.hypot(noise, THRESHOLDS.law_error * given)
    least = _APART * floor * np.maximum(1.0, rms(moved) / np.maximum(given, floor))
    while 2.0 * coarse <= _LONGEST_S:
        q = replayed(2.0 * coarse)
        if not (rms(q[1:] - q[0] - moved) <= least).all():
            break
        coarse *= 2.0
    return Steps(fine, coarse)


def _probes(motion: Motion) -> list[tuple[Planted, ...]]:
    """Laws in every joint that force, each so strong, is a share of all: dry friction comes first.

    The same by bristles, grease and rotors, whose forces follow the motion otherwise.
    """
    share = _PROBED * np.sqrt(np.mean(motion.demand**2, axis=0))
    fast, faster = (np.sqrt(np.mean(x**2, axis=0)) + 1e-12 for x in (motion.v, motion.a))
    sizes = {
        "joint.friction_coulomb": share[:, None],
        "joint.friction_stribeck": np.stack([share, share, 0.1 * fast], axis=1),
        "joint.friction_viscous": (share / fast)[:, None],
        "joint.armature": (share / faster)[:, None],
    }
    dofs = [(j, motion.scene.dof(j)) for j in motion.scene.own_joints]
    return [
        tuple(Planted(effects()[name], Location("joint", j), size[dof]) for j, dof in dofs)
        for name, size in sizes.items()
    ]


class Replays:
    """Extrapolated replays of hypotheses, those with a stiff law apart from the rest.

    Their steps may be shorter. Where nothing holds the base, what feet meet is as stiff as any.
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
        self._smooth = Extrapolated(scene, stretches, smooth)
        # what steps do to a gear is no correction of what they do without one
        self._stiff = self._smooth if scene.free else None
        self._reference: Sequence[Planted] = ()

    def of(self, hypothesis: Sequence[Planted]) -> Extrapolated:
        """The replays that a hypothesis takes."""
        if not any(p.effect.stiff for p in hypothesis):
            return self._smooth
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


_CLOSE = 0.3
"""Parameters of a hypothesis are close to another's within such a share of theirs."""
_KEPT = 4
"""Hypotheses whose differences are kept: a search comes back to where it was."""


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
        self._step = _STEP * self.nudge
        self.tolerances = tuple(tolerances)
        able = [tolerance.effect.correctable for tolerance in tolerances]
        self.able: Bool[np.ndarray, " tolerance"] = np.array(able, dtype=bool)
        self._known: list[_Changes] = []

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
        taken = [known for known in self._known if self._close(known.hypothesis, hypothesis)]
        if taken and not (anew and not self._once):
            return self._replays.around(here, [])[0], *taken[-1][1:]
        moved = [
            (*hypothesis, *self.rig(centre + one)) if t.effect.correctable else (*here, t.planted)
            for t, one in zip(self.tolerances, self._step * np.eye(len(centre)), strict=True)
        ]
        q, changes = self._replays.around(here, moved)
        changes = np.nan_to_num(changes) / np.where(self.able, self._step, 1.0)[:, None, None]
        response = np.zeros((*q.shape, 0))
        if self._remembers:
            response = responses(self._replays.of(here).slopes, here)
        kept = [k for k in self._known if not self._close(k.hypothesis, hypothesis)]
        self._known = [*kept[1 - _KEPT :], _Changes(tuple(hypothesis), changes, response)]
        return q, changes, response

    def _close(self, one: Sequence[Planted], other: Sequence[Planted]) -> bool:
        """Whether what one's tolerances change will do for the other's."""
        if [p.key for p in one] != [p.key for p in other]:
            return False
        sizes = [(p.theta, q.theta) for p, q in zip(one, other, strict=True)]
        near = (np.linalg.norm(b - a) <= _CLOSE * np.linalg.norm(a) for a, b in sizes)
        return self._once or (not self._remembers and all(near))
