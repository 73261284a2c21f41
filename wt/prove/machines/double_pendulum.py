"""Torque-controlled double pendulum C.1, dfki-ric-underactuated-lab/double_pendulum, BSD-3."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, imported, register
from wt.types import Recording
from wt.worlds.rigs import double_pendulum_spec

DRY, VISCOUS = (0.16, 0.12), 0.001  # N·m, N·m·s/rad: cf and b of its model 1.0


@register
class DoublePendulum(Machine):
    """Three runs to fit, two to score."""

    name: ClassVar[str] = "double_pendulum"
    folder: ClassVar[str] = "dfki_double_pendulum"
    source: ClassVar[str] = "dfki-ric-underactuated-lab/double_pendulum, BSD-3"
    fit: ClassVar[tuple[str, ...]] = ("c1_143339", "c1_143524", "c1_143704")
    holdout: ClassVar[tuple[str, ...]] = ("c1_143601", "c1_144003")
    known: ClassVar[str] = "dry friction of .16 and .12 N·m, by its laboratory"

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`."""
        return imported(home / self.folder / motion)

    def given(self) -> mujoco.MjSpec:
        """Rods, rotors and motors without friction."""
        return double_pendulum_spec()

    def published(self) -> mujoco.MjSpec:
        """With the dry and viscous friction of model 1.0."""
        return with_friction()


def with_friction() -> mujoco.MjSpec:
    """The double pendulum as its laboratory has it: model 1.0."""
    spec = double_pendulum_spec()
    for joint, dry in zip(("shoulder", "elbow"), DRY, strict=True):
        spec.joint(joint).frictionloss = dry
        spec.joint(joint).damping = [VISCOUS, 0.0, 0.0]
    return spec
