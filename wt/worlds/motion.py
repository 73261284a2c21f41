"""Reference motions of an arm: differential inverse kinematics towards random poses.

Solving one quadratic program per simulated arm and control step would cost several times more
than the physics. The library solves them once, along a few long joint-space routes at a coarse
rate, and collection plays them back from random places with cubic interpolation, so that many
arms share each solution and exploration noise keeps any two from moving alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mink
import mujoco
import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from wt.errors import ConfigError


@dataclass(frozen=True)
class MotionSettings:
    """Settings of reference motions.

    Attributes:
        routes: number of independent routes in the library.
        route_seconds: duration of each [s].
        solve_hz: rate at which differential inverse kinematics is solved [Hz].
        joint_speed: limit on every joint's speed from solution to solution [rad/s]; interpolation
            passes it by up to a third for moments.
        workspace: middle part of every joint's range that goals are drawn from [-].
        goal_seconds: a new goal is drawn at the latest after this long [s].
    """

    routes: int = 16
    route_seconds: float = 40.0
    solve_hz: float = 12.5
    joint_speed: float = 1.5
    workspace: float = 0.5
    goal_seconds: float = 2.4

    def __post_init__(self) -> None:
        """Refuse settings that no route follows from."""
        for name, value in vars(self).items():
            if not value > 0:
                raise ConfigError(f"world.motion.{name} is {value}; it must be above zero")
        if self.workspace > 1:
            raise ConfigError(
                f"world.motion.workspace is {self.workspace}; it is a share of the joint ranges, "
                "1 at most"
            )


def plan_routes(
    model: mujoco.MjModel, body: str, settings: MotionSettings, rate_hz: float, seed: int
) -> Float[np.ndarray, "route sample joint"]:
    """Joint-space routes that visit random end-effector poses.

    Goals are poses of ``body`` at random joint positions, hence inside the workspace; the way
    there is differential inverse kinematics with joint position and speed limits (mink).

    Args:
        model: the arm; its joints are the route's columns.
        body: name of the end-effector body.
        settings: see :class:`MotionSettings`.
        rate_hz: rate of the returned samples [Hz].
        seed: same seed, same routes.

    Returns:
        Joint positions [rad].
    """
    solved = math.ceil(settings.route_seconds * settings.solve_hz) + 1
    times = np.arange(solved) / settings.solve_hz
    sampled = np.arange(int(settings.route_seconds * rate_hz)) / rate_hz
    children = np.random.SeedSequence(seed).spawn(settings.routes)
    routes = [
        CubicSpline(times, _solve_route(model, body, settings, solved, np.random.default_rng(s)))(
            sampled
        )
        for s in children
    ]
    return np.stack(routes)


def _solve_route(
    model: mujoco.MjModel,
    body: str,
    settings: MotionSettings,
    samples: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"]:
    middle, half = model.jnt_range.mean(axis=1), np.ptp(model.jnt_range, axis=1) / 2
    low, high = middle - settings.workspace * half, middle + settings.workspace * half
    dt = 1.0 / settings.solve_hz
    joints = [model.joint(j).name for j in range(model.njnt)]
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict.fromkeys(joints, settings.joint_speed)),
    ]
    task = mink.FrameTask(body, "body", position_cost=1.0, orientation_cost=0.3, gain=0.3)
    # keeps elbow and wrist away from their stops where the pose leaves freedom
    rest = mink.PostureTask(model, cost=1e-2)
    rest.set_target(middle)
    goal = mink.Configuration(model)
    arm = mink.Configuration(model, rng.uniform(low, high))
    route = np.empty((samples, model.nq))
    steps_left = 0
    for k in range(samples):
        route[k] = arm.q
        if steps_left <= 0:
            goal.update(rng.uniform(low, high))
            task.set_target(goal.get_transform_frame_to_world(body, "body"))
            steps_left = int(rng.uniform(0.3, 1.0) * settings.goal_seconds * settings.solve_hz)
        velocity = mink.solve_ik(arm, [task, rest], dt, solver="daqp", damping=1e-2, limits=limits)
        arm.integrate_inplace(velocity, dt)
        steps_left -= 1
    return route
