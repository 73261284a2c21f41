"""EMPS: a carriage on a ball screw, driven by a DC motor.

A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, 2019,
nonlinearbenchmark.org.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, imported, register
from wt.types import Recording
from wt.worlds.rigs import empty

_MASS = 95.1089  # kg
_FORCE = 35.15065188  # N/V
_VISCOUS, _DRY, _OFFSET = 203.5034, 20.3935, -3.1648  # N·s/m, N, N


@register
class Stage(Machine):
    """One recording of 25 s to fit; one with force pulses to score."""

    name: ClassVar[str] = "stage"
    folder: ClassVar[str] = "emps"
    source: ClassVar[str] = "Janot, Gautier, Brunot: EMPS, nonlinearbenchmark.org"
    fit: ClassVar[tuple[str, ...]] = ("DATA_EMPS",)
    holdout: ClassVar[tuple[str, ...]] = ("DATA_EMPS_PULSES",)
    known: ClassVar[str] = (
        "viscous 203.5 N·s/m, dry 20.4 N, offset −3.2 N; the authors miss friction that differs "
        "with the direction, and a flexible mode"
    )

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`."""
        columns = {"qpos/slide": "qm", "ctrl/motor": "vir"}
        return imported(home / self.folder / f"{motion}.mat", {"time": "t", "columns": columns})

    def given(self) -> mujoco.MjSpec:
        """A mass on a rail and the motor's force; commands are volts."""
        spec = empty("emps", 0.001, gravity=0.0)
        carriage = spec.worldbody.add_body(name="carriage")
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        carriage.add_joint(name="slide", type=slide, axis=(1.0, 0.0, 0.0))
        box = mujoco.mjtGeom.mjGEOM_BOX
        carriage.add_geom(name="carriage", type=box, size=(0.1, 0.1, 0.05), mass=_MASS)
        motor = spec.add_actuator(name="motor", target="slide", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.gear = [_FORCE, 0.0, 0.0, 0.0, 0.0, 0.0]
        return spec

    def published(self) -> mujoco.MjSpec:
        """With the published friction and offset: M·a = force − Fv·v − Fc·sign(v) − offset."""
        spec = self.given()
        slide, motor = spec.joint("slide"), spec.actuator("motor")
        slide.damping, slide.frictionloss = [_VISCOUS, 0.0, 0.0], _DRY
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.biasprm[0] = -_OFFSET / _FORCE
        return spec
