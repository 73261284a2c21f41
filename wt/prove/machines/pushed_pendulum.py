"""The double pendulum C.1 while it is pushed at its joints at recorded times.

The pushes are torques that the motors added to those of the controller: Gaussians in time, 10 to
50 ms (deviation) and .2 to .75 N·m. The importer leaves out ``tau_pert``, where they stand.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, imported, register
from wt.prove.machines.double_pendulum import with_friction
from wt.types import Recording


@register
class PushedPendulum(Machine):
    """Two pushed runs to fit, one to score; the model has its friction."""

    name: ClassVar[str] = "pushed_pendulum"
    folder: ClassVar[str] = "dfki_pushed"
    source: ClassVar[str] = "dfki-ric-underactuated-lab/double_pendulum, BSD-3"
    fit: ClassVar[tuple[str, ...]] = ("acrobot_01", "acrobot_05")
    holdout: ClassVar[tuple[str, ...]] = ("acrobot_09",)
    known: ClassVar[str] = "pushes of .2 to .75 N·m at both joints, one or two each"

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`."""
        return imported(home / self.folder / f"{motion}.csv")

    def given(self) -> mujoco.MjSpec:
        """The pendulum with its published friction."""
        return with_friction()
