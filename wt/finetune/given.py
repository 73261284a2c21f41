"""S from a file instead of from the task: the robot as ``wt diagnose`` has repaired it."""

from __future__ import annotations

from pathlib import Path

import mujoco

from wt.errors import ModelError
from wt.worlds.go2_model import BALL
from wt.worlds.legged import Robot
from wt.worlds.legged_model import BASE, STAND


def read(path: str, robot: Robot, has_ball: bool) -> mujoco.MjSpec:
    """Read an MJCF and check that the robot's joints and drives are where they were.

    What a diagnosis changed of them, or added behind them, is simulated and never looked at.

    Args:
        path: of the file.
        robot: whose it is.
        has_ball: whether the task's S carries a ball, whose free joint is the last.

    Raises:
        ModelError: the file is missing or no MJCF, or the robot is not in it as it was.
    """
    if not Path(path).is_file():
        raise ModelError(f"{path} does not exist; name the model.xml that wt diagnose left")
    try:
        spec = mujoco.MjSpec.from_file(path)
        model = spec.compile()
    except ValueError as error:  # MuJoCo's, for what it cannot read or compile
        raise ModelError(f"{path} is no MJCF ({str(error).splitlines()[0]})") from error
    names = [model.joint(j).name for j in range(model.njnt)]
    wanted = [BASE, *robot.joints]
    if names[: len(wanted)] != wanted:
        raise ModelError(
            f"{path}: its joints begin with {', '.join(names[:2])}; {BASE} and then the "
            f"{robot.name}'s {robot.joints[0]} … {robot.joints[-1]} are needed"
        )
    if [model.actuator(k).name for k in range(model.nu)] != wanted[1:]:
        raise ModelError(f"{path}: its actuators are not one for each joint, in the joints' order")
    if has_ball != (names[-1] == BALL):
        needed = f"end with {BALL}" if has_ball else f"have no {BALL}"
        raise ModelError(f"{path}: its joints must {needed}, as the task's S does")
    if STAND not in [model.key(k).name for k in range(model.nkey)]:
        raise ModelError(f"{path} has no keyframe {STAND!r}, in which the robot starts")
    return spec
