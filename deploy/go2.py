"""A Go2 over DDS: the real one and, on another network interface, the simulated one.

The maker numbers motors leg by leg, FR, FL, RR, RL; a policy may have any order and names it. The
translation between the two is by name and happens here, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from deploy.dds import DdsParticipant
from deploy.idl import LowCmd_, LowState_
from deploy.messages import Packed
from deploy.remote import Remote
from deploy.robot import Command, Drives, State
from wt.errors import ModelError

LOW_COMMAND, LOW_STATE = "rt/lowcmd", "rt/lowstate"

JOINTS = tuple(
    f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")
)
"""Names of the motors, by the maker's numbers."""

# Published ranges [rad], torques [N·m] and speeds [rad/s] of the joints.
_RANGE = {"hip": (-1.0472, 1.0472), "calf": (-2.7227, -0.83776)}
_THIGH = {"F": (-1.5708, 3.4907), "R": (-0.5236, 4.5379)}
_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 45.43}
_SPEED = {"hip": 30.1, "thigh": 30.1, "calf": 15.7}

_SERVO = 1  # motor mode: field-oriented control, as kp, kd and tau say


class Go2:
    """The robot on the line; see :class:`deploy.robot.Robot`.

    Attributes:
        joints: names, in the order of all arrays.
        drives: what they can take.
    """

    def __init__(self, line: DdsParticipant, joints: Sequence[str]) -> None:
        """Listen for its state; nothing is sent yet.

        Args:
            line: the network it is on.
            joints: the policy's order.

        Raises:
            ModelError: these are not the Go2's joints.
        """
        self.joints = tuple(joints)
        self._motor = motors(joints)
        self.drives = drives(joints)
        self._states = line.inbox(LOW_STATE, LowState_)
        self._others = line.inbox(LOW_COMMAND, LowCmd_, depth=32)
        self._writer = line.writer(LOW_COMMAND, LowCmd_)
        self._message = _command()
        self._count = {"states": 0, "wrong_checksum": 0, "commands": 0}

    def read(self) -> State | None:
        """The newest state, or None; one whose checksum is wrong never came."""
        for message in self._states.take():
            # A simulator may leave the checksum out.
            if message.data["crc"] not in (0, message.checksum()):
                self._count["wrong_checksum"] += 1
                continue
            self._count["states"] += 1
            return unpack(message, self._motor)
        return None

    def send(self, command: Command) -> None:
        """Send a command to the twelve drives."""
        motors = self._message.data["motor_cmd"]
        motors["q"][self._motor] = command.target
        motors["kp"][self._motor] = command.stiffness
        motors["kd"][self._motor] = command.damping
        self._writer.write(self._message.seal())
        self._count["commands"] += 1

    def intruders(self) -> int:
        """Number of commands that somebody else sent since the last call, 32 at most."""
        return len(self._others.take())

    def health(self) -> Mapping[str, int]:
        """States, commands, and states that were thrown away."""
        return dict(self._count)


def motors(joints: Sequence[str]) -> np.ndarray:
    """The maker's number of each joint, (n,).

    Raises:
        ModelError: these are not the Go2's twelve, each once.
    """
    if sorted(joints) != sorted(JOINTS):
        odd = sorted(set(joints) ^ set(JOINTS)) or ["one twice"]
        raise ModelError(
            f"the policy's joints are not the Go2's ({', '.join(odd[:3])}); it has {len(JOINTS)}, "
            f"{JOINTS[0]} … {JOINTS[-1]}: take a policy that was trained for it"
        )
    return np.array([JOINTS.index(joint) for joint in joints])


def drives(joints: Sequence[str]) -> Drives:
    """Limits of joints and drives, in the order of ``joints``."""
    parts = [joint.split("_")[1] for joint in joints]
    ranges = [
        _THIGH[joint[0]] if part == "thigh" else _RANGE[part]
        for joint, part in zip(joints, parts, strict=True)
    ]
    low, high = np.array(ranges).T.copy()
    torque = np.array([_TORQUE[part] for part in parts])
    return Drives(low, high, torque, np.array([_SPEED[part] for part in parts]))


def unpack(message: Packed, motor: np.ndarray) -> State:
    """A message as a state, with motors in the given order."""
    data = message.data
    imu, measured = data["imu_state"], data["motor_state"][motor]
    return State(
        time=float(data["tick"]) / 1e3,
        position=measured["q"].astype(np.float64),
        velocity=measured["dq"].astype(np.float64),
        torque=measured["tau_est"].astype(np.float64),
        quaternion=imu["quaternion"].astype(np.float64),
        gyro=imu["gyroscope"].astype(np.float64),
        # the bytes are signed on the robot, and unsigned in the maker's Python
        temperature=measured["temperature"].astype(np.int8).astype(np.float64),
        battery=float(data["bms_state"]["soc"]),
        remote=Remote.unpack(data["wireless_remote"].tobytes()),
    )


def _command() -> Packed:
    """The constant part of every command: header, low level, no torque, motors under control."""
    message = LowCmd_()
    message.data["head"] = 0xFE, 0xEF
    message.data["level_flag"] = 0xFF
    message.data["motor_cmd"]["mode"] = _SERVO
    return message
