"""The R5 world: what is stored is what happened, to plain MuJoCo's eye."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.config import load
from wt.errors import ConfigError
from wt.types import Pairs, Transitions
from wt.worlds.base import make
from wt.worlds.r5 import R5World

JOINTS = [f"joint{i}" for i in range(1, 7)]
SMALL = [
    "world.arms=20", "world.episode_steps=100", "world.threads=1",
    "world.motion.routes=4", "world.motion.route_seconds=8",
]  # fmt: skip
COUNT = 2500  # not whole episodes, more than one batch of arms
CAPS = np.array([30, 30, 30, 10, 6, 3], dtype=float)


def world_of(root: Path, name: str, *more: str) -> R5World:
    world = make(load(root / "conf" / name, [*SMALL, *more]).world)
    assert isinstance(world, R5World)
    return world


@pytest.fixture(scope="module")
def world(root: Path) -> R5World:
    return world_of(root, "r5.yaml")


@pytest.fixture(scope="module")
def real(world: R5World) -> Transitions:
    return world.collect("real", COUNT, seed=5)


@pytest.fixture(scope="module")
def pairs(world: R5World) -> Pairs:
    return world.pairs("test", 300, seed=9)


def one_step(
    model: mujoco.MjModel, o: np.ndarray, a: np.ndarray, force: np.ndarray | None
) -> np.ndarray:
    """A control step of 20 ms by nothing but mj_step, the force held on the gripper's centre."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = o[:6], o[6:12], a
    if force is not None:
        data.body("gripper").xfrc_applied[:3] = force
    for _ in range(round(0.02 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


def rows_under_force(t: Transitions, n: int) -> np.ndarray:
    rows = np.flatnonzero(np.linalg.norm(t.hidden, axis=1) > 10)
    return rows[np.linspace(0, len(rows) - 1, n).astype(int)]


def test_spec(world: R5World) -> None:
    spec = world.spec
    assert (spec.task, spec.rate_hz, list(spec.joints)) == ("r5_force", 50.0, JOINTS)
    assert [(c.name, c.unit) for c in spec.observation] == [
        (f"{kind}/{joint}", unit)
        for kind, unit in (("qpos", "rad"), ("qvel", "rad/s"), ("last_action", "rad"))
        for joint in JOINTS
    ]
    assert [(c.name, c.unit) for c in spec.action] == [(f"ctrl/{j}", "rad") for j in JOINTS]
    assert [(c.name, c.unit) for c in spec.hidden] == [(f"force/{x}", "N") for x in "xyz"]
    assert spec.n_state == 12
    assert [spec.observation[i].name for i in spec.pose] == [f"qpos/{j}" for j in JOINTS]


def test_domains_differ_in_everything_the_task_says(world: R5World) -> None:
    sim, real = world.model("sim"), world.model("real")
    for field in ("dof_damping", "dof_frictionloss", "dof_armature", "body_mass"):
        assert (getattr(real, field)[1:] != getattr(sim, field)[1:]).any(), field
    assert (real.actuator_gainprm[:, 0] != sim.actuator_gainprm[:, 0]).all()
    np.testing.assert_array_equal(real.body_pos, sim.body_pos)


def test_episodes_are_whole_and_in_order(real: Transitions) -> None:
    assert len(real) == COUNT
    np.testing.assert_array_equal(real.episode, np.arange(COUNT) // 100)
    np.testing.assert_array_equal(real.step, np.arange(COUNT) % 100)
    follows = np.flatnonzero(real.step > 0)
    np.testing.assert_array_equal(real.o[follows, :12], real.s_next[follows - 1])
    np.testing.assert_array_equal(real.o[follows, 12:], real.a[follows - 1])
    assert real.o.dtype == np.float32


@pytest.mark.parametrize("domain", ["sim", "real"])
def test_stored_action_and_force_give_the_stored_outcome(world: R5World, domain: str) -> None:
    t = world.collect(domain, 400, seed=2)  # type: ignore[arg-type]
    model = world.model(domain)  # type: ignore[arg-type]
    for row in [*rows_under_force(t, 5), 0, 250]:
        again = one_step(model, t.o[row], t.a[row], t.hidden[row])
        np.testing.assert_allclose(again, t.s_next[row], atol=2e-5)


def test_nominal_is_s_without_force(world: R5World, real: Transitions) -> None:
    np.testing.assert_array_equal(world.sim_step(real.o, real.a, None), real.nominal)
    for row in rows_under_force(real, 4):
        expected = one_step(world.model("sim"), real.o[row], real.a[row], None)
        np.testing.assert_allclose(real.nominal[row], expected, atol=2e-5)


def test_pairs_put_s_under_the_same_force(world: R5World, pairs: Pairs) -> None:
    real = pairs.real
    for row in rows_under_force(real, 5):
        expected = one_step(world.model("sim"), real.o[row], real.a[row], real.hidden[row])
        np.testing.assert_allclose(pairs.sim_next[row], expected, atol=2e-5)
    on = np.linalg.norm(real.hidden, axis=1) > 10
    assert np.abs(pairs.sim_next[on] - real.nominal[on]).max() > 0.1
    off = (real.hidden == 0).all(axis=1)
    np.testing.assert_allclose(pairs.sim_next[off], real.nominal[off], atol=1e-6)


def test_same_seed_same_data_whatever_the_threads(root: Path, real: Transitions) -> None:
    again = world_of(root, "r5.yaml", "world.threads=2").collect("real", COUNT, seed=5)
    for name in ("o", "a", "s_next", "nominal", "hidden", "episode", "step"):
        np.testing.assert_array_equal(getattr(again, name), getattr(real, name))


def test_different_seeds_are_unpaired(world: R5World, real: Transitions) -> None:
    other = world.collect("real", 400, seed=6)
    assert np.abs(other.o[:400] - real.o[:400]).max(axis=1).min() > 1e-3
    # nor do two episodes of one collection repeat each other
    firsts = real.o[real.step == 0][:, :6]
    distance = np.linalg.norm(firsts[:, None] - firsts[None], axis=2)
    assert distance[np.triu_indices(len(firsts), 1)].min() > 1e-4


def test_force_is_bounded(world: R5World, real: Transitions) -> None:
    norm = np.linalg.norm(real.hidden, axis=1)
    assert norm.max() <= 200.0 + 1e-3
    assert norm.max() > 60.0
    assert 0.15 < (norm > 0).mean() < 0.45
    model = world.model("real")
    data = mujoco.MjData(model)
    jacobian = np.zeros((3, 6))
    gripper = model.body("gripper").id
    used = []
    for row in np.flatnonzero(norm > 0):
        data.qpos[:] = real.o[row, :6]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jac(model, data, jacobian, None, data.xpos[gripper], gripper)
        used.append((np.abs(jacobian.T @ real.hidden[row]) / CAPS).max())
    assert max(used) < 1.0001
    assert np.mean(np.array(used) > 0.9999) > 0.1  # and the caps do bind at times


def test_strong_forces_act_in_directions_in_which_the_joints_bear_them(root: Path) -> None:
    few = ("world.motion.routes=4", "world.motion.route_seconds=10", "world.arms=20")
    acts = []
    for name in ("r5.yaml", "r5_strong.yaml"):
        norm = np.linalg.norm(world_of(root, name, *few).collect("real", 4000, 5).hidden, axis=1)
        acts.append(norm[norm > 0])
        assert norm.max() <= 200.0 + 1e-3
    some, strong = acts
    assert np.median(some) < 70.0 and np.median(strong) > 80.0
    assert (some > 100.0).mean() < 0.1 and (strong > 100.0).mean() > 0.35


def test_no_force_near_limits_or_at_speed(world: R5World, real: Transitions) -> None:
    low, high = world.model("real").jnt_range.T
    on = np.linalg.norm(real.hidden, axis=1) > 0
    q, v = real.o[on, :6], real.o[on, 6:12]
    assert (q >= low + 0.1 - 1e-6).all()
    assert (q <= high - 0.1 + 1e-6).all()
    assert np.abs(v).max() <= 4.0 + 1e-6


def test_force_appears_turns_and_vanishes_as_said(root: Path) -> None:
    """Without bounds in the way the process has the rates of its settings."""
    free = world_of(
        root, "r5.yaml", "world.force.speed_cap=1e6", "world.force.limit_margin=0",
        "world.force.torque_cap=[1e6,1e6,1e6,1e6,1e6,1e6]", "world.force.max_newton=1",
    )  # fmt: skip
    t = free.collect("real", 8000, seed=1)
    inside = t.step > 0
    rows = np.flatnonzero(inside)
    low, high = free.model("real").jnt_range.T
    clear = ((t.o[:, :6] > low) & (t.o[:, :6] < high)).all(axis=1)
    rows = rows[clear[rows] & clear[rows - 1]]
    before, now = t.hidden[rows - 1], t.hidden[rows]
    was, on = (np.linalg.norm(x, axis=1) > 0 for x in (before, now))
    assert on[~was].mean() == pytest.approx(0.15, abs=0.025)
    assert 1 - on[was].mean() == pytest.approx(0.25, abs=0.04)
    both = was & on
    turned = np.abs(now[both] - before[both]).max(axis=1) > 0
    assert turned.mean() == pytest.approx(0.1 / 0.75, abs=0.04)
    directions = t.hidden[np.linalg.norm(t.hidden, axis=1) > 0.1]
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.abs(directions.mean(axis=0)).max() < 0.12  # from all sides alike


@pytest.mark.parametrize("domain", ["sim", "real"])
def test_arm_keeps_its_limits(world: R5World, real: Transitions, domain: str) -> None:
    t = real if domain == "real" else world.collect("sim", 1000, seed=5)
    low, high = world.model("real").jnt_range.T
    outside = (t.o[:, :6] < low) | (t.o[:, :6] > high)
    assert outside.mean() < 0.05
    assert (t.o[:, :6] > low - 0.2).all()
    assert (t.o[:, :6] < high + 0.2).all()
    assert (t.a >= low).all()
    assert (t.a <= high).all()


def test_policy_explores_and_reacts(root: Path, real: Transitions) -> None:
    """The arm gets about, and what it is sent depends on what pushed it: the paper's leakage."""
    assert np.ptp(real.o[:, :6], axis=0).min() > 1.0
    assert 0.1 < np.abs(real.o[:, 6:12]).mean() < 2.0
    # a force that never appears leaves every other random number as it was
    quiet = world_of(root, "r5.yaml", "world.force.appear=0").collect("real", 2000, seed=5)
    assert not quiet.hidden.any()
    np.testing.assert_array_equal(quiet.o[0], real.o[0])
    pushed = real.hidden[:2000].any(axis=1)
    start = np.flatnonzero(pushed)[0]
    assert np.abs(quiet.a[start + 1 : start + 40] - real.a[start + 1 : start + 40]).max() > 1e-3


def test_normal_hides_nothing(root: Path) -> None:
    normal = world_of(root, "r5_normal.yaml")
    assert normal.spec.task == "r5_normal"
    assert normal.spec.hidden == ()
    pairs = normal.pairs("validation", 150, seed=0)
    assert pairs.real.hidden.shape == (150, 0)
    np.testing.assert_array_equal(pairs.sim_next, pairs.real.nominal)
    np.testing.assert_array_equal(
        pairs.real.nominal, normal.sim_step(pairs.real.o, pairs.real.a, pairs.real.hidden)
    )
    expected = one_step(normal.model("sim"), pairs.real.o[77], pairs.real.a[77], None)
    np.testing.assert_allclose(pairs.real.nominal[77], expected, atol=2e-5)
    assert np.abs(pairs.real.s_next - pairs.real.nominal).max() > 0.05  # the arms do differ


def test_more_rows_than_simulations_fit_one_batch(world: R5World, real: Transitions) -> None:
    many = np.resize(np.arange(len(real)), 5000)
    out = world.sim_step(real.o[many], real.a[many], real.hidden[many])
    np.testing.assert_array_equal(out[: len(real)][: 5000 - len(real)], out[len(real) :])


def test_progress_ends_at_the_count(world: R5World) -> None:
    seen: list[tuple[int, int]] = []
    world.collect("sim", COUNT, 0, lambda done, total: seen.append((done, total)))
    assert seen == [(2000, COUNT), (COUNT, COUNT)]


def test_identity_changes_with_what_decides_the_data(root: Path, world: R5World) -> None:
    assert world.identity() == world_of(root, "r5.yaml", "world.threads=2").identity()
    for change in ("world.policy.noise=0.06", "world.force.turn=0.2", "world.timestep=0.001"):
        assert world_of(root, "r5.yaml", change).identity() != world.identity()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("world.timestep=0.003", r"world\.timestep 0\.003 s does not divide"),
        ("world.rate_hz=0", r"world\.rate_hz is 0"),
        ("world.arms=0", r"world\.arms is 0"),
        ("world.threads=-1", r"world\.threads is -1"),
        ("world.motion.route_seconds=1", r"world\.motion\.route_seconds 1 is shorter"),
        ("world.force.appear=2", r"world\.force\.appear is 2"),
        ("world.force.vanish=0.95", r"vanish 0\.95 and turn 0\.1"),
        ("world.force.max_newton=-1", r"world\.force\.max_newton is -1"),
        ("world.force.torque_cap=[1]", r"torque_cap is \(1\.0,\); 6 values"),
        ("world.policy.noise=-1", r"world\.policy"),
        ("world.policy.noise_seconds=0", r"world\.policy\.noise_seconds is 0"),
        ("world.sim.stiffness=[80,80]", r"stiffness of an arm is .*; 6 values"),
    ],
)
def test_refuses_impossible_options(root: Path, change: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        world_of(root, "r5.yaml", change)
    assert "\n" not in str(caught.value)


def test_answers_are_those_of_pairs(world: R5World, pairs: Pairs) -> None:
    np.testing.assert_array_equal(world.answers(pairs.real), pairs.sim_next)
    without = world.sim_step(pairs.real.o, pairs.real.a, None)
    assert not np.allclose(without, pairs.sim_next)
