"""The SO-101 world: layout and causality of transitions, S's step, and the splits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.conftest import FromShared
from wt.errors import ConfigError, DataError, ModelError
from wt.worlds import base, so101_model
from wt.worlds.so101 import RATE_HZ, SO101, SO101Options
from wt.worlds.so101_motions import TEST, TRAIN, VALIDATION

ROWS = 150
SPLITS: dict[str, Any] = {"train": ("a", "repeats/a"), "validation": ("b",), "test": ("c",)}


def write_motion(folder: Path, seed: int, gap: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """A motion of sines, positions three samples behind; returns commands and positions."""
    folder.mkdir(parents=True)
    k = np.arange(ROWS)[:, None]
    command = 0.2 * np.sin(0.1 * k + np.arange(6) + seed)
    position = 0.2 * np.sin(0.1 * (k - 3) + np.arange(6) + seed)
    command[:, 5], position[:, 5] = 0.5, 0.5
    stamp = 1e6 / RATE_HZ * np.arange(ROWS)
    if gap is not None:
        stamp[gap:] += 60_000.0
    zeros = str([0.5] * 6)

    def table(header: str, values: np.ndarray, rest: str) -> str:
        rows = (f'X,{t},"{list(map(float, v))}"{rest}' for t, v in zip(stamp, values, strict=True))
        return header + "\n" + "\n".join(rows) + "\n"

    control = table("type,timestamp,positions", command, "")
    header = "type,timestamp,positions,velocities,torques"
    (folder / "control.csv").write_text(control)
    (folder / "state_motor.csv").write_text(table(header, position, f',"{zeros}","{zeros}"'))
    return command, position


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("so101")
    for seed, name in enumerate(("a", "repeats/a", "b", "c")):
        write_motion(root / name, seed)
    return root


@pytest.fixture(scope="module")
def world(folder: Path) -> SO101:
    return SO101(SO101Options(recordings=str(folder), **SPLITS, history=2, threads=1))


def test_found_by_name(folder: Path) -> None:
    spec = base.make({"name": "so101", "recordings": str(folder), **SPLITS}).spec
    assert (spec.n_state, spec.n_action, len(spec.hidden)) == (10, 5, 0)
    assert spec.rate_hz == pytest.approx(49.85)
    assert len({channel.name for channel in spec.observation}) == spec.n_obs


def test_each_channel_holds_the_sample_its_name_says(tmp_path: Path) -> None:
    command, position = write_motion(tmp_path / "a", 0)
    write_motion(tmp_path / "b", 1)
    world = SO101(SO101Options(str(tmp_path), ("a",), ("b",), ("c",), history=3, threads=1))
    real = world.collect("real", 10**6, seed=0)
    assert len(real) == ROWS - 5  # four samples of lead, one of outcome
    joints = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"]
    for row in (0, 37, len(real) - 1):
        now = row + 4
        for i, channel in enumerate(world.spec.observation):
            name, _, lag = channel.name.partition("@-")
            kind, joint = name.split("/")
            j, k = joints.index(joint), now - int(lag or 0)
            expected = {
                "qpos": position[k, j],
                "qvel": (position[k, j] - position[k - 1, j]) * RATE_HZ,
                "last_action": command[k - 1, j],
                "ctrl": command[k, j],
            }[kind]
            assert real.o[row, i] == pytest.approx(expected, abs=1e-4), channel.name
        np.testing.assert_allclose(real.a[row], command[now, :5], atol=1e-6)
        np.testing.assert_allclose(real.s_next[row, :5], position[now + 1, :5], atol=1e-6)
        slope = (position[now + 1, :5] - position[now, :5]) * RATE_HZ
        np.testing.assert_allclose(real.s_next[row, 5:], slope, atol=1e-4)
        assert real.step[row] == row


def test_no_transition_across_a_gap(tmp_path: Path) -> None:
    write_motion(tmp_path / "a", 0, gap=60)
    world = SO101(SO101Options(str(tmp_path), ("a",), ("b",), ("c",), history=2, threads=1))
    real = world.collect("real", 10**6, seed=0)
    now = real.step + 3
    # samples now-3 … now+1 must not span the interval from sample 59 to 60
    assert not ((now - 3 <= 59) & (now + 1 >= 60)).any()
    assert len(real) == ROWS - 4 - 4


def reference_step(
    model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """One control step of plain MuJoCo, one simulation at a time, jaw half open."""
    data = mujoco.MjData(model)
    half = np.deg2rad(45.0)
    data.qpos, data.qvel, data.ctrl = [*q, half], [*v, 0.0], [*u, half]
    mujoco.mj_step(model, data, nstep=round(1.0 / (RATE_HZ * model.opt.timestep)))
    return data.qpos[:5].copy()


def test_sim_step_is_plain_mujoco(world: SO101) -> None:
    real = world.collect("real", 40, seed=0)
    answer = world.sim_step(real.o, real.a, None)
    for row in (0, 20, 39):
        o = real.o[row].astype(float)
        q = reference_step(world.model("sim"), o[:5], o[5:10], real.a[row].astype(float))
        np.testing.assert_allclose(answer[row, :5], q, atol=1e-6)
        np.testing.assert_allclose(answer[row, 5:], (q - o[:5]) * RATE_HZ, atol=1e-4)
    np.testing.assert_array_equal(real.nominal, answer)
    assert world.sim_step(real.o[:0], real.a[:0], None).shape == (0, 10)


def test_a_delay_applies_earlier_commands(folder: Path, world: SO101) -> None:
    real = world.collect("real", 30, seed=0)
    names = [channel.name for channel in world.spec.observation]
    earlier = {
        1: real.o[:, [names.index(f"last_action/{j}") for j in world.spec.joints]],
        2: real.o[:, [names.index(f"ctrl/{j}@-2") for j in world.spec.joints]],
    }
    for steps, command in earlier.items():
        delayed = SO101(
            SO101Options(str(folder), **SPLITS, history=2, delay=steps / RATE_HZ, threads=1)
        )
        np.testing.assert_allclose(
            delayed.sim_step(real.o, real.a, None), world.sim_step(real.o, command, None), atol=1e-6
        )
    half = SO101(SO101Options(str(folder), **SPLITS, history=2, delay=0.5 / RATE_HZ, threads=1))
    between = half.sim_step(real.o, real.a, None)[:, 0]
    whole = world.sim_step(real.o, real.a, None)[:, 0]
    late = world.sim_step(real.o, earlier[1], None)[:, 0]
    assert ((between - whole) * (between - late) <= 1e-9).all()


def test_a_diagnosed_arm_takes_the_place_of_the_published_one(
    folder: Path, world: SO101, tmp_path: Path
) -> None:
    real = world.collect("real", 30, seed=0)

    def answers(spec: mujoco.MjSpec, name: str) -> np.ndarray:
        (tmp_path / name).mkdir()
        (tmp_path / name / "model.xml").write_text(spec.to_xml())
        options = SO101Options(
            str(folder), **SPLITS, history=2, threads=1, model=str(tmp_path / name)
        )
        return SO101(options).sim_step(real.o, real.a, None)

    spec = so101_model.spec(so101_model.ServoPhysics(), 1e-3)
    spec.compile()
    as_published = world.sim_step(real.o, real.a, None)
    np.testing.assert_allclose(answers(spec, "same"), as_published, atol=1e-6)
    # what a drive's filter acts on is what the observed commands have left in it
    spec.actuator("elbow_flex").set_to_position(kp=17.8, kv=0.0, timeconst=1e-4)
    fast = answers(spec, "fast")[:, :5]
    np.testing.assert_allclose(fast, as_published[:, :5], atol=5e-4)
    spec.actuator("elbow_flex").delay, spec.actuator("elbow_flex").nsample = 1.0 / RATE_HZ, 30
    late = answers(spec, "late")
    changed = np.abs(late[:, :5] - fast).max(axis=0) > 1e-3
    assert changed.tolist() == [False, False, True, False, False]
    spec.delete(spec.actuator("gripper"))
    with pytest.raises(ModelError, match="has no actuator 'gripper'"):
        answers(spec, "other")


def test_simulation_is_seeded_unpaired_and_of_the_asked_size(world: SO101) -> None:
    first, again, other = (world.collect("sim", 730, seed) for seed in (1, 1, 2))
    assert len(first) == 730
    assert first.hidden.shape == (730, 0)
    assert list(np.unique(first.episode)) == [0, 1]
    np.testing.assert_array_equal(first.o, again.o)
    assert np.abs(first.o[:, :5] - other.o[:, :5]).max() > 0.01
    np.testing.assert_array_equal(first.s_next, world.sim_step(first.o, first.a, None))


def test_the_closed_loop_follows_its_commands(world: SO101) -> None:
    """A gain of 17.8 N·m/rad against 0.5 N·m of gravity, and no delay: it stays close."""
    sim = world.collect("sim", 500, seed=3)
    error = np.abs(sim.o[100:, :5] - sim.a[100:])
    assert error.max() < 0.2
    assert error.mean() < 0.06


def test_progress_reaches_the_count(world: SO101) -> None:
    seen: list[tuple[int, int]] = []
    world.collect("sim", 60, 0, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (60, 60)
    assert seen == sorted(seen)


def test_a_smaller_count_takes_unbroken_pieces_of_every_motion(world: SO101) -> None:
    real = world.collect("real", 100, seed=5)
    assert len(real) == 100
    for episode in (0, 1):
        assert (np.diff(real.step[real.episode == episode]) == 1).all()
        assert (real.episode == episode).sum() >= 49
    assert len(world.pairs("test", 10**6, 0)) == ROWS - 4
    pairs = world.pairs("validation", 50, 0)
    np.testing.assert_array_equal(world.answers(pairs.real), pairs.sim_next)
    np.testing.assert_array_equal(pairs.sim_next, pairs.real.nominal)


def test_options_that_make_no_sense(folder: Path) -> None:
    with pytest.raises(ConfigError, match="'a' is in both train and test"):
        SO101(SO101Options(str(folder), ("a",), ("b",), ("repeats/a",)))
    with pytest.raises(ConfigError, match=r"world\.validation is empty"):
        SO101(SO101Options(str(folder), ("a",), (), ("c",)))
    with pytest.raises(ConfigError, match=r"world\.delay"):
        SO101(SO101Options(str(folder), **SPLITS, history=1, delay=0.05))
    with pytest.raises(ConfigError, match=r"world\.history is 0"):
        SO101(SO101Options(str(folder), **SPLITS, history=0))
    with pytest.raises(ConfigError, match="'train' is not known"):
        SO101(SO101Options(str(folder), **SPLITS)).pairs("train", 1, 0)


def test_missing_recordings_are_one_clear_line(tmp_path: Path, folder: Path) -> None:
    for root, hint in ((tmp_path / "none", "does not exist"), (folder, r"control\.csv")):
        world = SO101(SO101Options(str(root), ("a", "zz"), ("b",), ("c",)))
        with pytest.raises(DataError, match=hint) as error:
            world.collect("real", 10, 0)
        assert "\n" not in str(error.value)


def test_default_splits_keep_repeats_together() -> None:
    sides = [{Path(name).name for name in side} for side in (TRAIN, VALIDATION, TEST)]
    assert not sides[0] & sides[1]
    assert not sides[0] & sides[2]
    assert not sides[1] & sides[2]
    assert len(set().union(*sides)) == 12


def test_real_pairs_of_the_held_out_motions(from_shared: FromShared) -> None:
    """S must know more than that nothing moves, and be off by what was published for it."""
    folder = from_shared("recordings/so101")
    pairs = SO101(SO101Options(str(folder), threads=1)).pairs("test", 4000, 0)
    change = (pairs.real.s_next - pairs.real.o[:, :10]).astype(float)
    error = (pairs.real.s_next - pairs.sim_next).astype(float)
    raw, persistence = (np.sqrt((x[:, :5] ** 2).mean(axis=0)) for x in (error, change))
    assert (raw < persistence).all()
    assert 0.001 < raw.mean() < 0.006
