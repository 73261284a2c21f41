"""What held-out recordings leave where no fitted one ever was.

A fit says little of where nothing was recorded: a cable that is in the way, a gear that is worn at
one place, a table. If most of what is left on held-out data is from there, no better fit of the
same recordings removes it, and another recording is what is wanted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.selection.holdout import Holdout
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

_MARGIN = 0.05
"""Share of its fitted range that a joint may leave it by: so far a law carries on."""
_MOST, _WORSE = 0.5, 2.0
"""Share of a joint's squared error that has to be from outside, and how many times its RMSE inside
it has to err by there: else it errs everywhere."""
_LEFT = 2.0
"""Noise that is left of a joint at least: else there is nothing to speak of."""


class Unvisited(NamedTuple):
    """A part of a joint's range that was held out and never fitted.

    Attributes:
        joint: which.
        above: whether it lies above the fitted range, or below it.
        end: where it begins [rad or m].
        seconds: that the held-out recordings are there.
        share: of the joint's squared error that is left, from these seconds.
        inside: its RMSE elsewhere [rad or m].
        outside: … and there.
    """

    joint: str
    above: bool
    end: float
    seconds: float
    share: float
    inside: float
    outside: float

    def sentence(self, scene: Scene) -> str:
        """For people."""
        units = units_at(scene, Location("joint", self.joint))
        where = f"{'above' if self.above else 'below'} {self.end:.3g} {units.position}"
        inside, outside = units.distance(self.inside), units.distance(self.outside)
        return (
            f"Of the squared error of {self.joint} that is left on held-out data, "
            f"{100.0 * self.share:.0f} % is from the {self.seconds:.2g} s in which it is {where}, "
            f"where no fitted recording goes: {outside} there, {inside} elsewhere. What is there "
            "no fit of these recordings can know: fit one that goes there too."
        )


def unvisited(
    fitted: Smoothed, holdout: Holdout, left: Float[np.ndarray, "sample dof"]
) -> Unvisited | None:
    """The part of a joint's range that most of what is left of it is from; None if none is.

    Args:
        fitted: the fitted recordings.
        holdout: the held-out ones.
        left: errors of their replays, with all that was found [rad or m].

    Returns:
        That of the joint that errs most, in noise.
    """
    scene, found = fitted.motion.scene, list[tuple[float, Unvisited]]()
    noise, dt = np.nan_to_num(holdout.smoothed.noise, nan=np.inf), _spacing(holdout)
    for joint in scene.own_joints:
        dof = scene.dof(joint)
        q, own, square = holdout.measured[:, dof], fitted.motion.q[:, dof], left[:, dof] ** 2
        known = np.isfinite(q) & np.isfinite(square)
        if not known.any() or np.sqrt(square[known].mean()) < _LEFT * noise[dof]:
            continue
        margin = _MARGIN * np.ptp(own)
        for above, end in ((False, own.min() - margin), (True, own.max() + margin)):
            outside = known & ((q > end) if above else (q < end))
            if not outside.any() or outside[known].all():
                continue
            share = float(square[outside].sum() / square[known].sum())
            inside, there = (float(np.sqrt(square[k].mean())) for k in (known & ~outside, outside))
            if share < _MOST or there < _WORSE * inside:
                continue
            seconds = float(dt[outside].sum())
            part = Unvisited(joint, above, float(end), seconds, share, inside, there)
            found.append((float(square[outside].sum()) / noise[dof] ** 2, part))
    return max(found, default=(0.0, None), key=lambda each: each[0])[1]


def _spacing(holdout: Holdout) -> Float[np.ndarray, " sample"]:
    """Time that each sample stands for [s]."""
    return np.concatenate([np.full(len(s.t), np.median(np.diff(s.t))) for s in holdout.stretches])
