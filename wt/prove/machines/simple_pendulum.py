"""Torque-limited simple pendulum with a quasi-direct drive (AK80-6).

dfki-ric-underactuated-lab/torque_limited_simple_pendulum, BSD-3.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, between, imported, register
from wt.types import Recording
from wt.worlds.rigs import add_pendulum, empty

_INERTIA, _MOMENT = 0.06259, 0.1022  # kg·m² about the pivot, kg·m
_MASS = 0.67531  # kg
_VISCOUS, _DRY, _OFFSET = 0.04707, 0.1839, -0.07586  # N·m·s/rad, N·m, N·m
_TOUCHED_S = 17.5  # somebody touches the rod of ``sac`` soon after


@register
class SimplePendulum(Machine):
    """Identification and one controller to fit, another controller to score."""

    name: ClassVar[str] = "simple_pendulum"
    folder: ClassVar[str] = "dfki_simple_pendulum"
    source: ClassVar[str] = "dfki-ric-underactuated-lab/torque_limited_simple_pendulum, BSD-3"
    fit: ClassVar[tuple[str, ...]] = ("system_identification", "control_method_sac")
    holdout: ClassVar[tuple[str, ...]] = ("control_method_energy_shaping",)
    known: ClassVar[str] = (
        "viscous .047 N·m·s/rad, dry .184 N·m, offset −.076 N·m, by its laboratory"
    )

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`; the command is the torque that was measured."""
        columns = {
            "qpos/pendulum": "position", "qvel/pendulum": "velocity", "ctrl/motor": "torque",
        }  # fmt: skip
        path = home / self.folder / f"{motion}.measured.csv"
        recording = imported(path, {"time": {"column": "time"}, "columns": columns})
        return between(recording, 0.0, _TOUCHED_S) if motion.endswith("sac") else recording

    def given(self) -> mujoco.MjSpec:
        """The rod of the published J and m·c."""
        spec, com = empty("dfki_simple_pendulum", 0.001), _MOMENT / _MASS
        rod = spec.worldbody.add_body(name="rod")
        add_pendulum(rod, "pendulum", _MASS, com, _INERTIA - _MASS * com**2)
        motor = spec.add_actuator(
            name="motor", target="pendulum", trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        motor.set_to_motor()
        return spec

    def published(self) -> mujoco.MjSpec:
        """With the published friction and offset: τ = … + Fv·v + Fc·atan(100 v) + offset."""
        spec = self.given()
        joint, motor = spec.joint("pendulum"), spec.actuator("motor")
        joint.damping = [_VISCOUS, 0.0, 0.0]
        # at all but the slowest motions atan(100 v) is ± π/2
        joint.frictionloss = 1.5708 * _DRY
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.biasprm[0] = -_OFFSET
        return spec
