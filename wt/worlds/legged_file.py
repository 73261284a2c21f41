"""A legged robot from a file instead of from published figures: what ``wt diagnose`` makes of it.

A diagnosis keeps names and order of what was in the model, so that whoever relies on a robot finds
it where it was. What it added (a load, friction of the ground) is simulated and never looked at.
"""

from __future__ import annotations

from pathlib import Path

import mujoco

from wt.errors import ModelError
from wt.worlds.go2_model import BALL
from wt.worlds.legged_model import BASE, STAND

_FREE, _HINGE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE


def read(path: str, joints: tuple[str, ...], has_ball: bool) -> mujoco.MjSpec:
    """Read an MJCF and check that a policy finds its robot in it.

    Args:
        path: of the file.
        joints: the robot's hinges in the policy's order.
        has_ball: whether the ball of :mod:`wt.worlds.go2_model` is to be the last joint.

    Raises:
        ModelError: the file is missing or no MJCF; joints, actuators or the keyframe are not where
            the policy expects them.
    """
    if not Path(path).is_file():
        raise ModelError(f"{path} does not exist; name the model.xml that wt diagnose left")
    try:
        spec = mujoco.MjSpec.from_file(path)
        model = spec.compile()
    except ValueError as error:  # MuJoCo's, for a file that it cannot read or compile
        raise ModelError(f"{path} is no MJCF ({str(error).splitlines()[0]})") from error
    names = [model.joint(j).name for j in range(model.njnt)]
    kinds = list(model.jnt_type)
    n = len(joints)
    first = names[: n + 1] == [BASE, *joints] and kinds[: n + 1] == [_FREE, *[_HINGE] * n]
    if not first:
        raise ModelError(
            f"{path}: its joints begin with {', '.join(names[:3])}, …; the free joint {BASE} and "
            f"then {joints[0]} … {joints[-1]} are needed, as in the model that was diagnosed"
        )
    if [model.actuator(k).name for k in range(min(model.nu, n))] != list(joints):
        raise ModelError(f"{path}: its first {n} actuators are not named like the joints they move")
    if has_ball != (names[-1] == BALL):
        wanted = f"end with the free joint {BALL}" if has_ball else f"have no joint {BALL}"
        raise ModelError(f"{path}: its joints must {wanted}, as the scene says")
    if STAND not in [model.key(k).name for k in range(model.nkey)]:
        raise ModelError(f"{path} has no keyframe {STAND!r}, in which the robot starts")
    return spec
