"""The runner's view of a robot. A real one and a simulated one look the same from here.

Arrays have one value per joint, in the order of :attr:`Robot.joints`, which is the policy's.

How to add a robot
==================

Write ``deploy/<name>.py`` with a class that has what :class:`Robot` has: it turns the robot's own
messages into a :class:`State`, a :class:`Command` into its own messages, and names and numbers of
motors into the policy's order. Its robot stands in ``wt/worlds/robots.py``, where the policy's card
is checked against it; ``deploy.policies`` and ``deploy.job`` choose by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from deploy.remote import Remote

Joints = Float64[np.ndarray, "joint"]


@dataclass(frozen=True, slots=True)
class State:
    """Measurements of a robot at one time.

    Attributes:
        time: the robot's own clock [s].
        position: of the joints [rad].
        velocity: of the joints [rad/s].
        torque: of the drives, as they estimate it [N·m].
        quaternion: orientation of the trunk in the world, wxyz.
        gyro: angular velocity of the trunk in its own frame [rad/s].
        temperature: of the drives [°C].
        battery: charge that is left [%].
        remote: the operator's remote control.
    """

    time: float
    position: Joints
    velocity: Joints
    torque: Joints
    quaternion: Float64[np.ndarray, "wxyz=4"]
    gyro: Float64[np.ndarray, "xyz=3"]
    temperature: Joints
    battery: float
    remote: Remote


@dataclass(frozen=True, slots=True)
class Command:
    """Command of the drives: torque = stiffness · (target − position) − damping · velocity.

    Attributes:
        target: joint positions [rad].
        stiffness: position gains [N·m/rad].
        damping: velocity gains [N·m·s/rad].
    """

    target: Joints
    stiffness: Joints
    damping: Joints


@dataclass(frozen=True)
class Drives:
    """Limits of joints and drives, by the robot's data sheet.

    Attributes:
        low: end of the joints' range [rad].
        high: its other end [rad].
        torque: largest, either way [N·m].
        speed: largest, either way [rad/s].
    """

    low: Joints
    high: Joints
    torque: Joints
    speed: Joints


@runtime_checkable
class Robot(Protocol):
    """A robot with position-controlled joints."""

    joints: tuple[str, ...]
    """Names, in the order of all arrays."""
    drives: Drives

    def read(self) -> State | None:
        """The newest state that came since the last call, or None; does not wait."""

    def send(self, command: Command) -> None:
        """Send a command to all drives."""

    def intruders(self) -> int:
        """Number of commands that somebody else sent since the last call."""

    def health(self) -> Mapping[str, int]:
        """Counts of what went wrong on the line since the start, for the log."""


class Silent:
    """A robot to which nothing is sent and whose other master is no intruder: ``--dry-run``."""

    def __init__(self, robot: Robot) -> None:
        """Listen to ``robot`` only."""
        self._robot, self.joints, self.drives = robot, robot.joints, robot.drives

    def read(self) -> State | None:
        """As :class:`Robot`."""
        return self._robot.read()

    def send(self, command: Command) -> None:
        """Nothing."""

    def intruders(self) -> int:
        """None: who only listens may listen to a robot that another program controls."""
        return 0

    def health(self) -> Mapping[str, int]:
        """As :class:`Robot`."""
        return self._robot.health()
