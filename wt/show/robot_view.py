"""One robot in a Rerun recording: its MJCF's geoms as primitives, its bodies' poses over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from jaxtyping import Float
from rerun.components import FillMode

from wt.show.colors import Color

_FIRST_HIDDEN_GROUP = 3  # MuJoCo's viewers draw geom groups 0–2 unless told otherwise


@dataclass(frozen=True)
class BodyPoses:
    """Poses of one robot's bodies over time, in its own world.

    Attributes:
        pos: origins of the body frames [m].
        quat: their orientations.
        com: centres of mass [m].
    """

    pos: Float[np.ndarray, "time body xyz=3"]
    quat: Float[np.ndarray, "time body wxyz=4"]
    com: Float[np.ndarray, "time body xyz=3"]

    @property
    def reach(self) -> float:
        """Largest distance of any body from the first one [m]."""
        return float(np.linalg.norm(self.pos[:, 1:] - self.pos[:, 1:2], axis=-1).max())


def body_poses(model: mujoco.MjModel, qpos: Float[np.ndarray, "time qpos"]) -> BodyPoses:
    """Poses of the bodies at generalised positions."""
    data = mujoco.MjData(model)
    poses = BodyPoses(
        pos=np.empty((len(qpos), model.nbody, 3)),
        quat=np.empty((len(qpos), model.nbody, 4)),
        com=np.empty((len(qpos), model.nbody, 3)),
    )
    for k, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        poses.pos[k], poses.quat[k], poses.com[k] = data.xpos, data.xquat, data.xipos
    return poses


def log_robot(
    recording: rr.RecordingStream,
    model: mujoco.MjModel,
    time: rr.TimeColumn,
    name: str,
    motion: BodyPoses,
    color: Color,
) -> None:
    """Log a robot below ``world/<name>``: label and geoms static, bodies' poses over ``time``.

    Args:
        recording: the one to log to.
        model: whose geoms are drawn, each as Rerun's primitive below its body.
        time: the time stamps.
        name: the robot's label and place among the entities.
        motion: poses of its bodies at each of them.
        color: of the whole robot.
    """
    drawn = [g for g in range(model.ngeom) if model.geom_group[g] < _FIRST_HIDDEN_GROUP]
    bodies = [model.body(b).name or f"body{b}" for b in range(model.nbody)]
    for geom in drawn:
        shape = _shape(model, geom, color)
        if shape is not None:
            body = bodies[model.geom_bodyid[geom]]
            part = ["world", name, body, model.geom(geom).name or f"geom{geom}"]
            recording.log(rr.new_entity_path(part), shape, static=True, strict=True)
    for b in np.unique(model.geom_bodyid[drawn]):
        columns = rr.Transform3D.columns(
            translation=motion.pos[:, b],
            quaternion=np.roll(motion.quat[:, b], -1, axis=1),  # wxyz → xyzw
        )
        send_columns(recording, ["world", name, bodies[b]], time, columns)

    foot = [*motion.pos[0, 1, :2], float(motion.pos[..., 2].min()) - 0.1 * motion.reach]
    label = rr.Points3D([foot], labels=[name], colors=[color], show_labels=True)
    recording.log(rr.new_entity_path(["world", name, "label"]), label, static=True, strict=True)


def _shape(model: mujoco.MjModel, geom: int, color: Color) -> rr.AsComponents | None:
    """A geom as Rerun's primitive in its body's frame; None for a plane (the view has a grid)."""
    kind = mujoco.mjtGeom(model.geom_type[geom])
    size, center = model.geom_size[geom], model.geom_pos[geom]
    w, x, y, z = model.geom_quat[geom]
    quaternions, fill = [[x, y, z, w]], FillMode.Solid
    match kind:
        case mujoco.mjtGeom.mjGEOM_PLANE:
            return None
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            half = np.repeat(size[0], 3) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
            return rr.Ellipsoids3D(
                half_sizes=[half], centers=[center], quaternions=quaternions, colors=[color],
                fill_mode=fill,
            )  # fmt: skip
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            # Rerun's capsule starts at its origin, MuJoCo's is centred there
            start = _rotate(model.geom_quat[geom], np.array([0.0, 0.0, -size[1]]))
            return rr.Capsules3D(
                lengths=[2 * size[1]], radii=[size[0]], translations=[center + start],
                quaternions=quaternions, colors=[color], fill_mode=fill,
            )  # fmt: skip
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return rr.Cylinders3D(
                lengths=[2 * size[1]], radii=[size[0]], centers=[center],
                quaternions=quaternions, colors=[color], fill_mode=fill,
            )  # fmt: skip
    # a box is its own bounding box; a mesh or any other shape is drawn as its bounding box
    offset = _rotate(model.geom_quat[geom], model.geom_aabb[geom, :3])
    return rr.Boxes3D(
        half_sizes=[model.geom_aabb[geom, 3:]], centers=[center + offset],
        quaternions=quaternions, colors=[color], fill_mode=fill,
    )  # fmt: skip


def _rotate(
    quat: Float[np.ndarray, "wxyz=4"], vector: Float[np.ndarray, "xyz=3"]
) -> Float[np.ndarray, "xyz=3"]:
    rotated = np.empty(3)
    mujoco.mju_rotVecQuat(rotated, vector, quat)
    return rotated


def send_columns(
    recording: rr.RecordingStream,
    path: list[str],
    time: rr.TimeColumn,
    columns: Iterable[rr.ComponentColumn],
) -> None:
    """Log a whole time series of one entity at once, and fail loudly if Rerun refuses it."""
    rr.send_columns(
        rr.new_entity_path(path), indexes=[time], columns=columns, recording=recording, strict=True
    )
