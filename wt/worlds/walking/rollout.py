"""The closed loop of a walking robot: its policy on R's states or on predicted ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from wt.errors import WorkError
from wt.worlds.closed_loop import ReferenceRollouts
from wt.worlds.legged import Herd, LeggedRobot, Start
from wt.worlds.policy import Policy
from wt.worlds.stance import HEIGHT, VELOCITY
from wt.worlds.walking.state import TRUNK

SETTLE = 25
"""Control steps that R walks before anything is recorded: episodes begin standing."""
MOST_SPEED = 4.0
"""Speed of the trunk that no Go2 or G1 reaches [m/s]."""
MOST_SPIN = 20.0
"""Turning rate that they do not reach either [rad/s]."""
MOST_HEIGHT = 2.0
"""Height of the trunk that it does not jump to, in units of its standing height [-]."""


def astray(
    robot: LeggedRobot,
    s: Float[np.ndarray, "robot state"],
    hidden: Float[np.ndarray, "robot hidden"],
    ground: Float[np.ndarray, " robot"] | float,
) -> Bool[np.ndarray, " robot"]:
    """True where no robot can be: base height, tilt or velocity out of bounds.

    Args:
        robot: has the bounds.
        s: state channels: angular velocity [rad/s] and direction of gravity first.
        hidden: hidden variables: position [m], heading [rad], velocity [m/s] of the trunk first.
        ground: height of the ground under the trunk [m], or one for all.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        height = hidden[:, HEIGHT] - ground
        tilted = -s[:, 5] < np.cos(robot.fall_tilt) * np.linalg.norm(s[:, 3:6], axis=1)
        out = (height < robot.fall_height) | (height > MOST_HEIGHT * robot.height) | tilted
        out |= np.linalg.norm(hidden[:, VELOCITY], axis=1) > MOST_SPEED
        out |= np.linalg.norm(s[:, :3], axis=1) > MOST_SPIN
    finite = np.isfinite(s).all(axis=1) & np.isfinite(hidden[:, :TRUNK]).all(axis=1)
    return np.asarray(out | ~finite)


def walk(
    herd: Herd,
    policy: Policy,
    read: Callable[[Herd], np.ndarray],
    *,
    start: Start,
    limits: Float[np.ndarray, "command=3"],
    command_seconds: float,
    past: int,
    horizon: int,
    rng: np.random.Generator,
) -> ReferenceRollouts:
    """A herd under its policy, without exploration noise, under changing commands.

    Args:
        herd: the robots.
        policy: that walks.
        read: reads the hidden variables of a herd, (robot, hidden).
        start: spread of the states in which they begin.
        limits: largest command either way [m/s, m/s, rad/s].
        command_seconds: mean time that a command holds [s].
        past: steps before the start of a rollout.
        horizon: steps of a rollout.
        rng: of starts and commands.

    Raises:
        WorkError: all of them fell.
    """
    robot, size, n = herd.robot, herd.size, 6 + 2 * len(herd.robot.joints)
    herd.reset(np.arange(size), rng, start)
    command = rng.uniform(-limits, limits, (size, 3))
    clock = policy.clock(size)
    rows: dict[str, list[np.ndarray]] = {"o": [], "a": [], "hidden": [], "context": []}
    lost = np.zeros(size, bool)
    for k in range(-SETTLE, past + horizon + 1):
        changed = rng.random(size) < herd.dt / command_seconds
        command[changed] = rng.uniform(-limits, limits, (int(changed.sum()), 3))
        seen = herd.observe()
        context = np.hstack([command, clock.read(herd.time, command)])
        o = np.hstack([seen[:, :n], robot.targets(herd.action)])
        hidden = read(herd)
        herd.step(policy.act(seen, context[:, :3], context[:, 3:]))
        ground = herd.ground.height(hidden[:, 0], hidden[:, 1])
        lost |= astray(robot, o[:, :n], hidden, ground)
        if k >= 0:
            now = {"o": o, "hidden": hidden, "context": context, "a": robot.targets(herd.action)}
            for name, value in now.items():
                rows[name].append(value.astype(np.float32))
    if lost.all():
        raise WorkError("all robots fell in R: the policy does not walk there; train one that does")
    histories = {name: np.stack(values, axis=1)[~lost] for name, values in rows.items()}
    return ReferenceRollouts(
        histories["o"],
        histories["a"][:, :-1],
        histories["hidden"],
        histories["context"][:, :-1],
        past,
    )
