"""Names of a machine's places, several of which may mean the same one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from wt.errors import ModelError
from wt.prove.rigs import Rig


@dataclass(frozen=True)
class Machine:
    """Names of a machine.

    Attributes:
        joints: joint names.
        drives: actuator → the joint that it drives.
        encoders: sensor → the joint whose position it reports.
    """

    joints: tuple[str, ...]
    drives: Mapping[str, str] = field(default_factory=dict)
    encoders: Mapping[str, str] = field(default_factory=dict)

    def place(self, kind: str, name: str) -> tuple[str, str]:
        """A place as (kind, name), the same for all names of it.

        A joint, the actuator that drives it and its encoder are one place, as is a pair in either
        order. Bodies must be exact.
        """
        if kind == "pair" or "+" in name:
            parts = [self.drives.get(part, part) for part in name.split("+")]
            return "pair", "+".join(sorted(parts))
        if kind in ("joint", "actuator") and name in self.drives:
            return "joint", self.drives[name]
        if kind == "sensor" and name in self.encoders:
            return "joint", self.encoders[name]
        if kind != "body" and name in self.joints:
            return "joint", name
        return ("whole", name) if name in ("all", "world") else (kind, name)


def of_rig(rig: Rig) -> Machine:
    """A rig of the trials."""
    drives = {f"{joint}_drive": joint for joint in rig.joints}
    return Machine(rig.joints, drives, {"encoder": rig.joints[0]})


def of_model(path: Path) -> Machine:
    """The machine of an MJCF.

    Raises:
        ModelError: it does not compile.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(
            f"model '{path}' does not compile: {str(error).splitlines()[0]}"
        ) from error
    of_joint = mujoco.mjtTrn.mjTRN_JOINT
    drives = {
        model.actuator(i).name: model.joint(model.actuator_trnid[i, 0]).name
        for i in range(model.nactuator)
        if model.actuator_trntype[i] == of_joint
    }
    encoders = {
        model.sensor(i).name: model.joint(model.sensor_objid[i]).name
        for i in range(model.nsensor)
        if model.sensor_type[i] == mujoco.mjtSensor.mjSENS_JOINTPOS
    }
    return Machine(tuple(model.joint(i).name for i in range(model.njnt)), drives, encoders)
