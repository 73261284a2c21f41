"""What a model's sensors show of forces that it leaves out.

A force δτ that the model leaves out changes the accelerations by M⁻¹δτ. Encoders show those of
their joints, a gyro or an accelerometer those of its body along its Jacobian: together C M⁻¹δτ.
Forces that sensors cannot tell from δτ are all that give the same. The least of them,
P δτ with P = Cᵀ(C M⁻¹Cᵀ)⁺C M⁻¹, is what they show; where every joint has an encoder that is δτ
itself. A joint without one moves as it likes, and its forces show by what they do to the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics import inertia
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.types import Location

Quantity = Literal["position", "velocity", "force", "turn", "move", "other"]
"""What a sensor says here: of a joint, of a drive, or of how a body turns or moves."""

_QUANTITIES: Mapping[str, Quantity] = {
    "JOINTPOS": "position",
    "ACTUATORPOS": "position",
    "JOINTVEL": "velocity",
    "ACTUATORVEL": "velocity",
    "ACTUATORFRC": "force",
    "JOINTACTFRC": "force",
    "GYRO": "turn",
    "FRAMEQUAT": "turn",
    "FRAMEXAXIS": "turn",
    "FRAMEYAXIS": "turn",
    "FRAMEZAXIS": "turn",
    "FRAMEANGVEL": "turn",
    "FRAMEANGACC": "turn",
    "ACCELEROMETER": "move",
    "VELOCIMETER": "move",
    "FRAMEPOS": "move",
    "FRAMELINVEL": "move",
    "FRAMELINACC": "move",
}
"""By MuJoCo's name of the sensor's kind; all others say nothing here."""
_JACOBIANS = {
    mujoco.mjtObj.mjOBJ_SITE: mujoco.mj_jacSite,
    mujoco.mjtObj.mjOBJ_BODY: mujoco.mj_jacBodyCom,
    mujoco.mjtObj.mjOBJ_XBODY: mujoco.mj_jacBody,
    mujoco.mjtObj.mjOBJ_GEOM: mujoco.mj_jacGeom,
}
_UNSEEN = 1e-9  # of the largest singular value of what is measured: rounding


@dataclass(frozen=True)
class Measured:
    """What the sensors of a model measure.

    Attributes:
        declared: whether the model has any encoder; without, one on every joint is assumed.
        joints: whose position is measured.
        speeds: whose velocity is measured, and no position.
        drives: actuators whose force is measured.
        bodies: indices of sensors that turn or move with a body.
        others: sensors that say nothing here, by name.
    """

    declared: bool
    joints: tuple[str, ...]
    speeds: tuple[str, ...]
    drives: tuple[str, ...]
    bodies: tuple[int, ...]
    others: tuple[str, ...]

    def shown(self, motion: Motion) -> Float[np.ndarray, "sample dof dof"] | None:
        """P at every sample; None where forces show as they are.

        Args:
            motion: of the machine.
        """
        scene, own = motion.scene, {*self.joints, *self.speeds}
        if own.issuperset(scene.own_joints):
            return None
        model, data = scene.model, mujoco.MjData(scene.model)
        nv = model.nv
        encoders = np.eye(nv)[[scene.dof(name) for name in scene.own_joints if name in own]]
        found = np.zeros((len(motion), nv, nv))
        for k, q in enumerate(motion.q):
            mass = inertia.of_joints(model, data, q)
            rows = np.concatenate([encoders, *(self._rows(model, data, i) for i in self.bodies)])
            if len(rows):
                follows = np.linalg.solve(mass, rows.T)
                seen = np.linalg.pinv(rows @ follows, rcond=_UNSEEN, hermitian=True)
                found[k] = rows.T @ seen @ follows.T
        return found

    def may_be(self, effect: str, at: Location) -> bool:
        """Whether an effect may be at a place: faults of a measurement only where that is made."""
        if not effect.startswith("sensor.") or at.kind != "joint":
            return True
        if effect == "sensor.offset":  # a velocity has no zero that was set
            return at.name in self.joints
        return at.name in (*self.joints, *self.speeds)

    @staticmethod
    def _rows(
        model: mujoco.MjModel, data: mujoco.MjData, sensor: int
    ) -> Float[np.ndarray, "axis dof"]:
        moves, turns = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        kind = mujoco.mjtObj(int(model.sensor_objtype[sensor]))
        _JACOBIANS[kind](model, data, moves, turns, int(model.sensor_objid[sensor]))
        return turns if _quantity(model, sensor) == "turn" else moves

    def to_json(self) -> dict[str, Any]:
        """As in ``plan.json``."""
        return {
            "declared": self.declared,
            "positions": list(self.joints),
            "velocities": list(self.speeds),
            "forces": list(self.drives),
            "not_used": list(self.others),
        }


def measured(scene: Scene) -> Measured:
    """Read off what the sensors that a model declares measure.

    Args:
        scene: the machine.
    """
    sensors: dict[Quantity, list[int]] = {quantity: [] for quantity in get_args(Quantity)}
    for i in range(scene.model.nsensor):
        sensors[_quantity(scene.model, i)].append(i)
    positions, speeds = (
        {_joint(scene, i) for i in sensors[quantity]} for quantity in ("position", "velocity")
    )
    declared, own = bool(positions or speeds), scene.own_joints
    return Measured(
        declared,
        tuple(j for j in own if j in positions or not declared),
        tuple(j for j in own if j in speeds - positions),
        tuple(dict.fromkeys(name for i in sensors["force"] for name in _drives(scene, i))),
        tuple(sorted(sensors["turn"] + sensors["move"])),
        tuple(scene.model.sensor(i).name for i in sensors["other"]),
    )


def _quantity(model: mujoco.MjModel, sensor: int) -> Quantity:
    """What a sensor says here; of a body only where its place has a Jacobian."""
    kind = mujoco.mjtSensor(int(model.sensor_type[sensor])).name.removeprefix("mjSENS_")
    quantity = _QUANTITIES.get(kind, "other")
    of_body = quantity in ("turn", "move")
    place = mujoco.mjtObj(int(model.sensor_objtype[sensor]))
    return "other" if of_body and place not in _JACOBIANS else quantity


def _of_joint(model: mujoco.MjModel, sensor: int) -> bool:
    return int(model.sensor_objtype[sensor]) == mujoco.mjtObj.mjOBJ_JOINT


def _joint(scene: Scene, sensor: int) -> str:
    """The joint that a sensor is of, itself or as what its drive moves; empty if none."""
    of = int(scene.model.sensor_objid[sensor])
    if _of_joint(scene.model, sensor):
        return str(scene.model.joint(of).name)
    return next((drive.joint for drive in scene.drives if drive.index == of), "")


def _drives(scene: Scene, sensor: int) -> list[str]:
    """The drives whose force a sensor measures: itself, or together at their joint."""
    if _of_joint(scene.model, sensor):
        joint = _joint(scene, sensor)
        return [drive.name for drive in scene.drives if drive.joint == joint]
    of = int(scene.model.sensor_objid[sensor])
    return [drive.name for drive in scene.drives if drive.index == of]
