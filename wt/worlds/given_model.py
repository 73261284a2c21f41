"""A robot's MJCF from a file, such as a diagnosis writes, in place of the one built here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco

from wt.worlds import model_file
from wt.worlds.go2_model import BALL
from wt.worlds.legged import RATE_HZ, LeggedRobot
from wt.worlds.legged_model import BASE, STAND


def load(path: Path | str, robot: LeggedRobot) -> mujoco.MjModel:
    """Compile an MJCF and check that it is one of this robot.

    Names decide: joints, their drives, the trunk's free joint, feet and the keyframe in which it
    stands have to be there, in any order. What else is in it is hidden state: a load on slides, a
    gear's play.

    Args:
        path: the MJCF, or a diagnosis' folder.
        robot: whose it is to be.

    Raises:
        ModelError: it cannot be read, or is of another robot.
    """
    model = model_file.read(path)
    model_file.refuse(path, robot.name, _differences(model, robot))
    return model


def _differences(model: mujoco.MjModel, robot: LeggedRobot) -> Iterator[str]:
    """Reasons why a model is not one of a robot, the plainest first."""
    kinds = mujoco.mjtObj
    needed = (
        ("joint", kinds.mjOBJ_JOINT, (BASE, *robot.joints)),
        ("actuator", kinds.mjOBJ_ACTUATOR, robot.joints),
        ("body", kinds.mjOBJ_BODY, (robot.trunk,)),
        ("site", kinds.mjOBJ_SITE, robot.feet),
        ("keyframe", kinds.mjOBJ_KEY, (STAND,)),
    )
    yield from model_file.lacking(model, needed)
    if int(model.joint(BASE).qposadr[0]):
        yield f"its free joint '{BASE}' is not the first"
    scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    for joint in (model.joint(i) for i in range(model.njnt)):
        if joint.name not in (BASE, BALL) and int(joint.type[0]) not in scalar:
            yield f"its joint '{joint.name}' is neither hinge nor slide"
    substeps = 1.0 / (RATE_HZ * model.opt.timestep)
    if abs(substeps - round(substeps)) > 1e-6:
        yield (
            f"its time step of {model.opt.timestep:g} s does not divide the control step of "
            f"{1 / RATE_HZ:g} s"
        )
