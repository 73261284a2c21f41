"""How long the physics steps of replays may be."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis, Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scales import step_sizes
from wt.types import Location

COARSE = 2.0
"""Physics step of most replays at least, in fine ones; the extrapolation needs two."""
_LONGEST_S = 8e-3
"""Longest physics step of most replays [s]."""
_EXACT, _APART, _PROBED = 0.15, 0.3, 0.05
"""What longer fine steps, and coarse ones, may be off by, in what no law is asked to explain, with
laws of such a share of all force."""
_MOVED = 0.1
"""Parameters of stiff laws are probed such a share of themselves away."""

Paths = Float[np.ndarray, "probe sample dof"]
"""Positions of replays of some hypotheses, the first of which the others are probes of."""


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What steps may be off by.

    Attributes:
        noise: of the sensors, infinite where it is not known.
        given: root mean square error of the model as it is given.
    """

    noise: Float[np.ndarray, " dof"]
    given: Float[np.ndarray, " dof"]

    def exact(
        self, said: Float[np.ndarray, "sample dof"], q: Float[np.ndarray, "sample dof"]
    ) -> bool:
        """Whether positions are as good as exact ones."""
        return bool((_rms(said - q) <= _EXACT * self.noise).all())

    def apart(self, said: Paths, q: Paths) -> bool:
        """Whether probes differ from the first as they do in exact replays."""
        moved = q[1:] - q[0]
        # what is forgiven to any law is forgiven to steps
        floor = np.hypot(self.noise, THRESHOLDS.law_error * self.given)
        least = _APART * floor * np.maximum(1.0, _rms(moved) / np.maximum(self.given, floor))
        return bool((_rms(said[1:] - said[0] - moved) <= least).all())


@dataclass(frozen=True)
class Steps:
    """Physics steps of replays [s].

    Attributes:
        fine: of those few that say what a reference does.
        coarse: of those many that say what is different from it.
        accuracy: by which these were chosen; None where nothing is known of what longer ones do.
    """

    fine: float
    coarse: float
    accuracy: Accuracy | None = None

    @classmethod
    def usual(cls, fine: float) -> Steps:
        """Those where nothing is known of what longer ones do."""
        return cls(fine, COARSE * fine)

    def at_least(self, fine: float) -> Steps:
        """The same, where none may be shorter than a fine one."""
        fine = max(fine, self.fine)
        return replace(self, fine=fine, coarse=max(COARSE * fine, self.coarse))


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
    probes = [(), *_probes(motion)]
    replayer = functools.cache(functools.partial(Replayer, scene, stretches))

    def replayed(long: float, count: int) -> Paths:
        return np.asarray(replayer(long).run(probes[:count]).q)

    def extrapolated(long: float, count: int = 2) -> Paths:
        return 2.0 * replayed(long, count) - replayed(COARSE * long, count)

    given = np.sqrt(np.nanmean((extrapolated(step)[0] - measured) ** 2, axis=0))
    accuracy = Accuracy(np.nan_to_num(smoothed.noise, nan=np.inf), given)
    fine = step
    while 2.0 * fine <= scene.model.opt.timestep and accuracy.exact(
        extrapolated(2.0 * fine)[1], extrapolated(fine)[1]
    ):
        fine *= 2.0
    coarse, every = COARSE * fine, len(probes)
    exact = extrapolated(fine, every)
    while 2.0 * coarse <= _LONGEST_S and accuracy.apart(replayed(2.0 * coarse, every), exact):
        coarse *= 2.0
    return Steps(fine, coarse, accuracy)


def shortest(each: Sequence[Steps]) -> Steps:
    """Steps that do wherever one of several does, judged as the first is."""
    fine, coarse = (min(getattr(s, name) for s in each) for name in ("fine", "coarse"))
    return replace(each[0], fine=fine, coarse=coarse)


def probes_of(stiff: Hypothesis, motion: Motion) -> list[Hypothesis]:
    """Stiff laws, the same somewhat larger and smaller, and beside dry friction in every joint."""
    moves = [_MOVED * p.theta * (step_sizes(p, motion) > 0.0) for p in stiff]
    moved = [
        tuple(Planted(p.effect, p.at, p.moved(sign * x)) for p, x in zip(stiff, moves, strict=True))
        for sign in (1.0, -1.0)
    ]
    return [stiff, *moved, (*stiff, *_probes(motion)[0])]


def _rms(error: Float[np.ndarray, "*probe sample dof"]) -> Float[np.ndarray, "*probe dof"]:
    return np.asarray(np.sqrt(np.mean(error**2, axis=-2)))


def _probes(motion: Motion) -> list[Hypothesis]:
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
