"""A Go2 in MuJoCo that takes the commands of a real one's drives.

Each drive's torque is kp·(q − measured) + kd·(dq − measured) + tau, as on the robot. The gains are
written into MuJoCo's actuators, whose velocity part the integrator takes implicitly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from deploy import go2
from deploy.idl import LowState_
from deploy.messages import Packed
from deploy.motion import DAMPING
from deploy.robot import Command
from wt.errors import ModelError
from wt.worlds import go2_model
from wt.worlds.legged_model import BASE, GYRO, ORIENTATION, hang

TICK = 0.002
"""From one state to the next [s]."""

STALE_COMMAND = 0.02
"""Age of the newest command beyond which the robot brakes by itself [s]."""

JOINTS = go2_model.JOINTS

_GEAR, _COUNTS, _TORQUE = 6.33, 2**15, go2.drives(JOINTS).torque
ENCODER_STEP = 2.0 * np.pi / (_COUNTS * _GEAR) * (_TORQUE.min() / _TORQUE)
"""Steps of the measured positions, (12,) [rad]: a rotor's turn has 2¹⁵, and a knee is geared by as
much more as it is stronger. So they are in recordings of a real one: 30 and 16 µrad."""

_TIMESTEP = 0.001
_ACCELEROMETER = "accelerometer"
_LYING = (0.47, 1.13, -2.72, -0.47, 1.13, -2.72) * 2  # rad: folded, the trunk on the floor
_LYING_HEIGHT = 0.06  # m
_SETTLE = 0.5  # s
_MILLI = 1e3


class SimRobot:
    """The robot; it lies on the floor at first.

    Attributes:
        data: MuJoCo's state.
        command: what the drives do.
        stale: whether they brake because no command comes.
        hung: whether its trunk is held above the floor.
        missed: time that passed without physics [s].
    """

    def __init__(
        self,
        edit: Callable[[mujoco.MjSpec], None] = lambda spec: None,
        hung: bool = False,
        machine: Path | None = None,
    ) -> None:
        """Put it down and let it settle.

        Args:
            edit: makes it another robot than the published one, in place.
            hung: whether its trunk is held above the floor; a machine from a file says so itself.
            machine: MJCF of another Go2, as :func:`read` takes it.

        Raises:
            ModelError: it is not a Go2.
        """
        spec = read(machine) if machine else go2_model.spec(go2_model.PUBLISHED, _TIMESTEP)
        spec.option.timestep = _TIMESTEP
        if machine:
            hung = spec.joint(BASE) is None
        elif hung:
            hang(spec)
        edit(spec)
        spec.add_sensor(
            name=_ACCELEROMETER, type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
            objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu",
        )  # fmt: skip
        self._model = spec.compile()
        self.data = mujoco.MjData(self._model)
        self._motor = go2.motors(JOINTS)
        first = self._model.joint(JOINTS[0])
        self._first, self.hung = (first.qposadr[0], first.dofadr[0]), hung
        none = np.zeros(len(JOINTS))
        self._idle = Command(none, none, none)
        self._brake = Command(none, none, none + DAMPING)
        self.command, self.stale, self.missed = self._brake, False, 0.0
        self._push: np.ndarray | float = 0.0
        self._heard: float | None = None
        if not hung:
            self.data.joint(BASE).qpos[2] = _LYING_HEIGHT
        self.joints[:] = _LYING
        for _ in range(round(_SETTLE / TICK)):
            self.step(0.0)
        self.data.time = 0.0
        self.command = self._idle

    def hear(self, message: Packed, now: float) -> bool:
        """Take a command at ``now`` [s]; one whose checksum is wrong is ignored."""
        if message.data["crc"] != message.checksum():
            return False
        self._heard = now
        sent = message.data["motor_cmd"][self._motor]
        target, stiffness, damping = (sent[x].astype(np.float64) for x in ("q", "kp", "kd"))
        self._push = sent["tau"] + damping * sent["dq"]
        self.command = Command(target, stiffness, damping)
        return True

    def step(self, now: float) -> None:
        """One tick of physics; brakes if the newest command is too old at ``now`` [s]."""
        self.stale = self._heard is not None and now - self._heard > STALE_COMMAND
        if self.stale:
            self.command, self._push = self._brake, 0.0
        model, command = self._model, self.command
        model.actuator_gainprm[:, 0] = command.stiffness
        model.actuator_biasprm[:, 0] = self._push
        model.actuator_biasprm[:, 1] = -command.stiffness
        model.actuator_biasprm[:, 2] = -command.damping
        self.data.ctrl[:] = command.target
        mujoco.mj_step(model, self.data, round(TICK / _TIMESTEP))

    def state(self, remote: bytes) -> Packed:
        """The robot's own message about itself.

        Args:
            remote: the remote control's 40 bytes.
        """
        message, data = LowState_(), self.data
        fields = message.data
        fields["head"] = 0xFE, 0xEF
        fields["level_flag"] = 0xFF
        fields["tick"] = round(self.time * _MILLI)
        fields["wireless_remote"] = np.frombuffer(remote, np.uint8)
        imu, drives = fields["imu_state"], fields["motor_state"]
        w, x, y, z = imu["quaternion"] = data.sensor(ORIENTATION).data
        imu["gyroscope"] = data.sensor(GYRO).data
        imu["accelerometer"] = data.sensor(_ACCELEROMETER).data
        imu["rpy"] = (
            math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
            math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        )
        drives["mode"][self._motor] = 1
        drives["q"][self._motor] = ENCODER_STEP * np.round(self.joints / ENCODER_STEP)
        drives["dq"][self._motor] = self.speeds
        drives["tau_est"][self._motor] = data.actuator_force
        drives["temperature"][self._motor] = 30
        fields["bms_state"]["soc"], fields["power_v"] = 100, 28.8
        return message.seal()

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return float(self.data.time) + self.missed

    @property
    def joints(self) -> np.ndarray:
        """Positions, (12,) [rad], in the order of :data:`JOINTS`; live."""
        start = self._first[0]
        return self.data.qpos[start : start + len(JOINTS)]

    @property
    def speeds(self) -> np.ndarray:
        """Velocities, (12,) [rad/s]; live."""
        start = self._first[1]
        return self.data.qvel[start : start + len(JOINTS)]

    def truth(self) -> np.ndarray:
        """The true state, also what only a simulator or motion capture knows: :func:`columns`."""
        data = self.data
        trunk = (data.qpos[:7], data.qvel[:6])
        if self.hung:
            held = data.body(go2_model.TRUNK)
            trunk = (np.concatenate([held.xpos, held.xquat]), np.zeros(6))
        return np.concatenate([*trunk, self.joints, self.speeds, data.actuator_force])


def read(path: Path) -> mujoco.MjSpec:
    """Read the MJCF of a Go2 that is not the published one, such as has something to be found.

    Names decide, as in what ``wt model go2`` prints; with ``--hung`` the trunk has no free joint.

    Raises:
        ModelError: MuJoCo cannot load it, or it is not a Go2.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        model = spec.copy().compile()
    except (ValueError, OSError, mujoco.FatalError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ModelError(f"--model {path} does not load: {reason}") from error
    drives = tuple(model.actuator(i).name for i in range(model.nu))
    joints = tuple(model.joint(i).name for i in range(model.njnt))
    where = joints.index(JOINTS[0]) if JOINTS[0] in joints else 0
    lacking = [
        what
        for what, there in (
            (f"the joints {JOINTS[0]} … {JOINTS[-1]}", joints[where:][: len(JOINTS)] == JOINTS),
            (f"the drives {JOINTS[0]} … {JOINTS[-1]}", drives == JOINTS),
            (f"the sensor {GYRO}", spec.sensor(GYRO) is not None),
            (f"the sensor {ORIENTATION}", spec.sensor(ORIENTATION) is not None),
            ("the site imu", spec.site("imu") is not None),
        )
        if not there
    ]
    if lacking:
        raise ModelError(
            f"--model {path} is no Go2: it lacks {', '.join(lacking)}, one after the other and "
            "nothing between; begin with what `wt model go2` prints"
        )
    return spec


def columns() -> list[str]:
    """Names of :meth:`SimRobot.truth`, in order."""
    names = [f"qpos/{BASE}/{k}" for k in range(7)] + [f"qvel/{BASE}/{k}" for k in range(6)]
    return names + [f"{kind}/{joint}" for kind in ("qpos", "qvel", "force") for joint in JOINTS]
