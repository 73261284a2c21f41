"""Reference motions: they reach their goals, obey their limits and repeat themselves."""

from __future__ import annotations

import mink
import mujoco
import numpy as np
import pytest

from wt.errors import ConfigError
from wt.worlds.motion import MotionSettings, plan_routes

# A planar arm is enough: two links of 0.3 m and a wrist, limits that matter.
ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="a"><joint name="j1" axis="0 0 1" range="-2 2"/><geom size=".02" mass="1"/>
      <body name="b" pos=".3 0 0"><joint name="j2" axis="0 0 1" range="0 2.5"/>
        <geom size=".02" mass="1"/>
        <body name="tip" pos=".3 0 0"><joint name="j3" axis="0 1 0" range="-1 1"/>
          <geom size=".02" mass="1"/></body></body></body>
  </worldbody>
</mujoco>"""
LIMITS = np.array([[-2, 2], [0, 2.5], [-1, 1]], dtype=float)
RATE = 50.0
SETTINGS = MotionSettings(routes=3, route_seconds=12.0, joint_speed=1.2, workspace=0.9)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM)


@pytest.fixture(scope="module")
def routes(model: mujoco.MjModel) -> np.ndarray:
    return plan_routes(model, "tip", SETTINGS, RATE, seed=3)


def test_layout(routes: np.ndarray) -> None:
    assert routes.shape == (3, 600, 3)
    assert np.isfinite(routes).all()


def test_joint_limits(routes: np.ndarray) -> None:
    # the spline between solutions may pass a limit by the width of a hair
    assert (routes > LIMITS[:, 0] - 0.03).all()
    assert (routes < LIMITS[:, 1] + 0.03).all()


def test_joint_speed(routes: np.ndarray) -> None:
    every = int(RATE / SETTINGS.solve_hz)
    between_solutions = np.diff(routes[:, ::every], axis=1) * SETTINGS.solve_hz
    assert np.abs(between_solutions).max() <= SETTINGS.joint_speed + 1e-6
    assert np.abs(between_solutions).max() > 0.9 * SETTINGS.joint_speed  # it is used, too
    assert np.abs(np.diff(routes, axis=1) * RATE).max() <= 1.35 * SETTINGS.joint_speed


def test_moves_all_the_time_and_each_route_elsewhere(routes: np.ndarray) -> None:
    speed = np.linalg.norm(np.diff(routes, axis=1) * RATE, axis=2)
    window = int(RATE * SETTINGS.goal_seconds)
    peaks = [speed[:, k : k + window].max(axis=1) for k in range(0, speed.shape[1], window)]
    assert np.min(peaks) > 0.2  # it never sits at a goal for longer than goal_seconds
    assert np.ptp(routes, axis=1).min() > 0.5
    assert np.abs(routes[0] - routes[1]).max() > 0.5


def test_goal_is_reached(model: mujoco.MjModel, monkeypatch: pytest.MonkeyPatch) -> None:
    goals: list[mink.SE3] = []
    set_target = mink.FrameTask.set_target

    def record(task: mink.FrameTask, goal: mink.SE3) -> None:
        goals.append(goal)
        set_target(task, goal)

    monkeypatch.setattr(mink.FrameTask, "set_target", record)
    one_goal = MotionSettings(routes=1, route_seconds=8.0, goal_seconds=80.0, workspace=0.7)
    for seed in range(3):
        goals.clear()
        route = plan_routes(model, "tip", one_goal, RATE, seed)[0]
        assert len(goals) == 1
        data = mujoco.MjData(model)
        start, end = (tip(model, data, q) for q in (route[0], route[-1]))
        goal = goals[0].translation()
        assert np.linalg.norm(start - goal) > 0.05
        assert np.linalg.norm(end - goal) < 0.01
        turn = goals[0].rotation().as_matrix().T @ data.body("tip").xmat.reshape(3, 3)
        assert np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)) < 0.05


def tip(model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray) -> np.ndarray:
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return data.body("tip").xpos.copy()


def test_same_seed_same_routes(model: mujoco.MjModel) -> None:
    short = MotionSettings(routes=2, route_seconds=2.0)
    first = plan_routes(model, "tip", short, RATE, seed=1)
    np.testing.assert_array_equal(first, plan_routes(model, "tip", short, RATE, seed=1))
    assert np.abs(first - plan_routes(model, "tip", short, RATE, seed=2)).max() > 0.1


@pytest.mark.parametrize(("seconds", "solve_hz"), [(2.03, 12.5), (1.5, 7.0)])
def test_clocks_that_do_not_divide(model: mujoco.MjModel, seconds: float, solve_hz: float) -> None:
    """The spline is never asked beyond its last solution, where it would run away."""
    odd = MotionSettings(routes=2, route_seconds=seconds, solve_hz=solve_hz)
    routes = plan_routes(model, "tip", odd, RATE, seed=0)
    assert routes.shape[1] == int(seconds * RATE)
    assert np.abs(np.diff(routes, axis=1) * RATE).max() <= 1.35 * odd.joint_speed


def test_goals_change_even_when_shorter_than_a_solution(model: mujoco.MjModel) -> None:
    hasty = MotionSettings(routes=1, route_seconds=16.0, goal_seconds=0.1)
    late = plan_routes(model, "tip", hasty, RATE, seed=0)[0][400:]
    assert np.ptp(late, axis=0).max() > 0.1


@pytest.mark.parametrize(
    ("name", "value"),
    [("routes", 0), ("solve_hz", 0.0), ("joint_speed", -1.0), ("workspace", 1.5),
     ("goal_seconds", float("nan"))],
)  # fmt: skip
def test_refuses_impossible_settings(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"world\.motion\.{name} is {value}"):
        MotionSettings(**{name: value})  # type: ignore[arg-type]
