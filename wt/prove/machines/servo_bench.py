"""Dynamixel XL330 that moves a mass on an arm, Rhoban/bam, Apache-2.0."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, imported, register
from wt.types import Recording
from wt.worlds.rigs import MotorConstants, servo_bench_spec

_KP = 200
# published fit m1: rotor [kg·m²], dry [N·m] and viscous [N·m·s/rad] friction
_ROTOR, _DRY, _VISCOUS = 0.0018141672784458866, 0.01283272036582759, 0.003661672282824312


@register
class ServoBench(Machine):
    """Two trajectories at one gain to fit, another to score."""

    name: ClassVar[str] = "servo_bench"
    folder: ClassVar[str] = "bam_xl330"
    source: ClassVar[str] = "Rhoban/bam, Apache-2.0"
    fit: ClassVar[tuple[str, ...]] = ("kp200_sin_sin", "kp200_sin_time_square")
    holdout: ClassVar[tuple[str, ...]] = ("kp200_up_and_down",)
    known: ClassVar[str] = "friction that grows with the load of the gear; a supply that sags"

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`."""
        return imported(home / self.folder / f"{motion}.json")

    def given(self) -> mujoco.MjSpec:
        """A mass on a thin arm and the servo at its nominal supply."""
        return servo_bench_spec(_KP)

    def published(self) -> mujoco.MjSpec:
        """With rotor and friction of fit m1, the richest that MJCF has words for."""
        spec = servo_bench_spec(_KP, MotorConstants())
        hinge = spec.joint("hinge")
        hinge.armature, hinge.frictionloss, hinge.damping = _ROTOR, _DRY, [_VISCOUS, 0.0, 0.0]
        return spec
