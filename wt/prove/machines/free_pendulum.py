"""A pendulum that nothing drives, dynamicslab/MultiArm-Pendulum, MIT."""

from __future__ import annotations

import math
from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, imported, register
from wt.types import Recording
from wt.worlds.rigs import add_pendulum, empty

# published fit: centre of mass [m], mass [kg], inertia about it [kg·m²], friction [N·m·s/rad], g
_COM, _MASS, _INERTIA = 0.147754901, 0.147584572, 1.09118505e-4
_VISCOUS, _GRAVITY = 2.23940125e-4, 9.81001310


@register
class FreePendulum(Machine):
    """Four swings to fit, two to score: ``id/0`` … ``vad/1``."""

    name: ClassVar[str] = "free_pendulum"
    folder: ClassVar[str] = "multiarm_pendulum"
    source: ClassVar[str] = "dynamicslab/MultiArm-Pendulum, MIT"
    fit: ClassVar[tuple[str, ...]] = ("id/0", "id/1", "id/2", "id/3")
    holdout: ClassVar[tuple[str, ...]] = ("vad/0", "vad/1")
    known: ClassVar[str] = (
        "dry 6.4e-4 N·m and quadratic 1.7e-5 N·m·s²/rad² say it better than viscous"
    )

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`."""
        kind, number = motion.split("/")
        columns = {
            f"{group}/hinge": {"array": f"Y_{kind}/{number}", "index": index}
            for index, group in enumerate(("qpos", "qvel"))
        }
        path = home / self.folder / "SinglePendulumDataForParameterEstimation.mat"
        # its angles are from upright
        offsets = {"qpos/hinge": -math.pi}
        time = f"Time_{kind}/{number}"
        return imported(path, {"time": time, "columns": columns, "offsets": offsets})

    def given(self) -> mujoco.MjSpec:
        """The rod as published."""
        spec = empty("free_pendulum", 0.001, _GRAVITY)
        add_pendulum(spec.worldbody.add_body(name="rod"), "hinge", _MASS, _COM, _INERTIA)
        return spec

    def published(self) -> mujoco.MjSpec:
        """With the published viscous friction."""
        spec = self.given()
        spec.joint("hinge").damping = [_VISCOUS, 0.0, 0.0]
        return spec
