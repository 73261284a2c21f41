"""A real Unitree Go2 whose trunk is held while chirps move its legs.

iit-DLSLab/sim2real-robot-identification, BSD-3.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import mujoco

from wt.prove.machines.base import Machine, between, imported, register
from wt.types import Recording
from wt.worlds import go2_model, legged_model

_SPANS = {"first": (0.0, 15.6), "last": (15.7, 60.0)}  # s of the only recording


@register
class HeldGo2(Machine):
    """The first two thirds of the recording to fit, the rest to score."""

    name: ClassVar[str] = "held_go2"
    folder: ClassVar[str] = "go2_suspended"
    source: ClassVar[str] = "iit-DLSLab/sim2real-robot-identification, BSD-3"
    fit: ClassVar[tuple[str, ...]] = ("first",)
    holdout: ClassVar[tuple[str, ...]] = ("last",)
    known: ClassVar[str] = "one calf (RL) differs most; 10 ms of delay help"

    def read(self, home: Path, motion: str) -> Recording:
        """See :meth:`Machine.read`."""
        columns = {
            f"{group}/{joint}": {"array": array, "index": i}
            for group, array in (("qpos", "dof_pos"), ("ctrl", "des_dof_pos"))
            for i, joint in enumerate(go2_model.JOINTS)
        }
        path = home / self.folder / "traj_0.npz"
        recording = imported(path, {"time": {"array": "time"}, "columns": columns})
        return between(recording, *_SPANS[motion])

    def given(self) -> mujoco.MjSpec:
        """The public Go2 with its trunk fixed and the gains of the recording."""
        gains = replace(go2_model.PUBLISHED, stiffness=(20.0,), velocity_gain=(1.5,))
        spec = go2_model.spec(gains, 0.002, floor=False)
        trunk = spec.body(go2_model.TRUNK)
        for joint in list(trunk.joints):
            spec.delete(joint)
        spec.delete(spec.key(legged_model.STAND))  # its pose has a trunk that floats
        return spec
