"""What an experiment may ask of drives, and where the machine may be: recordings and model say so.

Reach (:mod:`wt.diagnose.experiment.reach`) is of each joint by itself. Here are the forces that
drives give, at once and in the mean square, by which their windings warm up, and the room that the
machine has been in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from wt.diagnose.experiment.reach import Shown
from wt.physics.activation import integrating
from wt.physics.scene import Scene

_MORE = 1.3
"""Forces, where the model limits none, and their mean square may be so many times those shown."""
_EDGE = 0.02  # share of a model's range of forces that is left out at either end
_LASTING = 0.35
"""Share of its greatest force that a drive gives for long without growing hot, as motors do."""
_POSES = 500  # at most about twice so many poses of a motion are looked at
_ROOM, _LEAST_M = 0.1, 0.02
"""Further than it was the machine may go by so much of the room that it was in, at least [m]."""


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of an experiment.

    Attributes:
        scene: the machine.
        force: lowest and greatest force of each drive, before its gear [N·m or N].
        lasting: greatest root mean square of it.
        room: corners of the box that holds the machine [m]; None if it may go anywhere.
    """

    scene: Scene
    force: Float[np.ndarray, "end actuator"]
    lasting: Float[np.ndarray, " actuator"]
    room: Float[np.ndarray, "end 3"] | None

    def broken(
        self, force: Float[np.ndarray, "sample actuator"], q: Float[np.ndarray, "sample dof"]
    ) -> bool:
        """Whether a motion breaks them.

        Args:
            force: of the drives; NaN where it is not known.
            q: joint positions [rad or m].
        """
        low, high = self.force
        if ((force < low) | (force > high)).any():
            return True
        if (np.sqrt((force**2).mean(axis=0)) > self.lasting).any():
            return True
        if self.room is None:
            return False
        low, high = room(self.scene, q)
        return bool((low < self.room[0]).any() or (high > self.room[1]).any())


def limits_of(
    scene: Scene,
    shown: Sequence[Shown],
    acted: Sequence[Float[np.ndarray, "_ actuator"]],
    whole_range: bool,
) -> Limits:
    """Limits by what was recorded and what the model says.

    Args:
        scene: the machine.
        shown: its motions so far.
        acted: what its drives acted on in each of them.
        whole_range: whether the model's joint ranges are free of obstacles.
    """
    m = scene.model
    most, lasting = np.zeros(m.nactuator), np.zeros(m.nactuator)
    boxes = []
    for motion, u in zip(shown, acted, strict=True):
        q = np.where(np.isfinite(motion.q), motion.q, motion.replayed)
        known = np.isfinite(q).all(axis=1)
        if not known.any():
            continue
        force = forces(scene, u[known], q[known], np.nan_to_num(motion.v[known]))
        most = np.maximum(most, np.quantile(np.abs(force), 0.995, axis=0))
        lasting = np.maximum(lasting, np.sqrt((force**2).mean(axis=0)))
        boxes.append(room(scene, q[known]))
    # of a drive whose force is not known nothing was shown
    untold = np.isnan(most) | (not boxes)
    most, lasting = np.where(untold, np.inf, most), np.where(untold, np.inf, lasting)
    limited = m.actuator_forcelimited.astype(bool)
    margin = _EDGE * np.ptp(m.actuator_forcerange, axis=1)
    ends = np.where(
        limited, m.actuator_forcerange.T + margin * [[1.0], [-1.0]], _MORE * most * [[-1.0], [1.0]]
    )
    greatest = np.where(limited, np.abs(m.actuator_forcerange).max(axis=1), 0.0)
    box = None
    if not whole_range and boxes:
        low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
        more = np.maximum(_ROOM * (high - low), _LEAST_M)
        box = np.stack([low - more, high + more])
    return Limits(scene, ends, np.fmax(_MORE * lasting, _LASTING * greatest), box)


def forces(
    scene: Scene,
    acted: Float[np.ndarray, "sample actuator"],
    q: Float[np.ndarray, "sample dof"],
    v: Float[np.ndarray, "sample dof"],
) -> Float[np.ndarray, "sample actuator"]:
    """Forces of drives before their gears, by the model's law; NaN where that does not say them.

    Args:
        scene: the machine.
        acted: what drives act on.
        q: joint positions [rad or m].
        v: joint velocities [rad/s or m/s].
    """
    found = np.full(acted.shape, np.nan)
    dynamic = set(integrating(scene.model))
    for d in scene.drives:
        if d.index not in dynamic:
            force = d.unclamped(acted[:, d.index], q[:, d.dof], v[:, d.dof])
            found[:, d.index] = np.clip(force, *d.forces)
    return found


def room(scene: Scene, q: Float[np.ndarray, "sample dof"]) -> Float[np.ndarray, "end 3"]:
    """Corners of the box that holds all that moves of a machine, wherever it is in a motion [m]."""
    m, data = scene.given, mujoco.MjData(scene.given)
    bodies = np.flatnonzero(m.body_weldid != 0)
    geoms = np.flatnonzero(m.body_weldid[m.geom_bodyid] != 0)
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    corners = m.geom_aabb[geoms, None, :3] + signs * m.geom_aabb[geoms, None, 3:]
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for pose in q[:: max(1, len(q) // _POSES)]:
        data.qpos[:] = pose
        mujoco.mj_kinematics(m, data)
        turned = corners @ data.geom_xmat[geoms].reshape(-1, 3, 3).swapaxes(1, 2)
        points = (turned + data.geom_xpos[geoms, None]).reshape(-1, 3)
        points = np.concatenate([points, data.xipos[bodies]])
        low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
    return np.stack([low, high])
