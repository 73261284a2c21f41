"""Commands from a file at work: joint targets one after the other, whatever the robot does.

For a robot whose trunk is held, as the experiments of ``wt ask`` want it. Gains are those of the
MJCF that the experiment was designed on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float64

from deploy.robot import Joints, State
from wt.errors import ModelError, RecordingError
from wt.types import Recording

Gains = tuple[Joints, Joints]
"""Position [N·m/rad] and velocity gains [N·m·s/rad]."""


class Playback:
    """Targets of every joint at a fixed rate; see :class:`deploy.motion.Source`.

    Attributes:
        pose: where they begin [rad].
        gains: position and velocity gains of the drives [N·m/rad, N·m·s/rad].
        rate_hz: of the targets.
        seconds: nothing is computed, so that it stays empty.
    """

    def __init__(
        self, targets: Float64[np.ndarray, "t joint"], rate_hz: float, gains: Gains
    ) -> None:
        """Nothing is played yet.

        Args:
            targets: [rad], in the robot's order.
            rate_hz: of its rows.
            gains: of :func:`servo_gains`.
        """
        self._targets, self.rate_hz, self.gains = targets, rate_hz, gains
        self.pose: Joints = targets[0]
        self.seconds: list[float] = []
        self.begin()

    @property
    def over(self) -> bool:
        """True once the last target had its time."""
        return self._played > len(self._targets)

    def begin(self) -> None:
        """Start anew."""
        self._played = 0

    def ask(self, state: State, command: np.ndarray) -> None:
        """Go on to the next target."""
        self._played += 1

    def answer(self, wait: float) -> np.ndarray | None:
        """The target that was asked for last [rad]; after the last one, that."""
        return np.asarray(self._targets[min(self._played, len(self._targets)) - 1])

    def targets(self, action: np.ndarray) -> Joints:
        """The same."""
        return action


def joint_targets(
    commands: Recording, joints: Sequence[str]
) -> tuple[Float64[np.ndarray, "t joint"], float]:
    """What a recording has to send to each joint [rad], and its rate [Hz].

    Raises:
        RecordingError: a joint has no command, or the samples are not evenly spaced.
    """
    missing = [name for name in joints if f"ctrl/{name}" not in commands.columns]
    if missing:
        raise RecordingError(f"no column ctrl/{missing[0]}: commands name every joint")
    steps = np.diff(commands.t)
    if np.ptp(steps) > 0.1 * float(np.median(steps)):
        raise RecordingError("commands to play are evenly spaced; these are not")
    targets = np.column_stack([commands.columns[f"ctrl/{name}"] for name in joints])
    if not np.isfinite(targets).all():
        raise RecordingError("commands to play are numbers throughout; these are not")
    return targets, 1.0 / float(np.median(steps))


def servo_gains(model: Path, joints: Sequence[str]) -> Gains:
    """Gains of the position servos of an MJCF, in the order of joints.

    Raises:
        ModelError: it does not load, or a joint has no servo of its own that holds positions.
    """
    try:
        compiled = mujoco.MjModel.from_xml_path(str(model))
    except (ValueError, OSError) as error:
        raise ModelError(f"{model} does not load: {str(error).splitlines()[0]}") from error
    stiffness, damping = np.zeros(len(joints)), np.zeros(len(joints))
    for k, name in enumerate(joints):
        try:
            drive = compiled.actuator(name)
        except KeyError:
            raise ModelError(f"{model} has no actuator {name}, which the robot has") from None
        kp, kv = float(drive.gainprm[0]), -float(drive.biasprm[2])
        if not (kp > 0.0 and kv >= 0.0 and np.isclose(drive.biasprm[1], -kp)):
            raise ModelError(
                f"actuator {name} of {model} is no position servo, as the robot's drives are"
            )
        stiffness[k], damping[k] = kp, kv
    return stiffness, damping
