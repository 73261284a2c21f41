"""Where a base was of which only an IMU was recorded, against where it was."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.conftest import FromShared
from tests.physics import stool
from wt.diagnose.observed.observer import Observer
from wt.diagnose.recordings import odometry
from wt.diagnose.recordings.odometry import located
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.residual.screen import Screen
from wt.errors import RecordingError
from wt.physics import base
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Channel, Recording

SENSORS = ("gyro", "accelerometer", "orientation")


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return stool.scene(tmp_path_factory.mktemp("stool"))


@pytest.fixture(scope="module")
def whole() -> Recording:
    return stool.recording(5, seconds=5.0, imu=SENSORS)


def without_base(recording: Recording, *sensors: str) -> Recording:
    """Only an IMU and the joints."""
    columns = {
        name: x
        for name, x in recording.columns.items()
        if "/root/" not in name and (name[:7] != "sensor/" or name.split("/")[1] in sensors)
    }
    return replace(recording, columns=columns)


@pytest.mark.parametrize("sensors", [("gyro", "accelerometer"), ("gyro", "orientation"), SENSORS])
def test_base_is_where_it_was(machine: Scene, whole: Recording, sensors: tuple[str, ...]) -> None:
    known = without_base(whole, *sensors)
    found = located(machine, "root", whole.t, known.columns)
    now, true = (base.coordinates("root", c) for c in (found, whole.columns))

    def off(name: str) -> np.ndarray:
        return np.asarray(now[name] - true[name])[50:]  # it drops onto its feet at first

    assert np.ptp(true["qpos/root/z"][50:]) > 0.005  # it does move
    assert np.sqrt(np.mean(off("qpos/root/z") ** 2)) < 0.002
    limit = 0.001 if "orientation" in sensors else 0.004
    for angle in ("pitch", "roll"):
        assert np.std(off(f"qpos/root/{angle}")) < limit < 0.5 * np.std(true[f"qpos/root/{angle}"])
    assert np.ptp(off("qpos/root/yaw")) < 0.01
    speed = np.stack([off(f"qvel/root/{axis}") for axis in "xyz"])
    true_speed = np.stack([true[f"qvel/root/{axis}"][50:] for axis in "xyz"])
    assert np.sqrt(np.mean(speed**2)) < 0.25 * np.sqrt(np.mean(true_speed**2))
    assert np.abs(off("qpos/root/x")).max() < 0.25 * np.ptp(true["qpos/root/x"][50:])


def test_a_speed_that_is_off_leads_down_no_slope() -> None:
    """Three feet of a walk that goes 0.5 m/s ahead, and sinks by 3 cm/s as far as speeds tell."""
    t = np.linspace(0.0, 5.0, 501)
    feet = np.array([[0.2, 0.1, -0.3], [-0.2, -0.1, -0.3], [-0.2, 0.1, -0.3]])
    swings = 0.05 * np.sin(2.0 * np.pi * t)[:, None]
    for rise in (0.0, 0.1):
        place = np.tile(feet, (len(t), 1, 1))
        place[:, :, 0] += swings
        place[:, :, 2] += rise * place[:, :, 0]
        low, weight = np.zeros(place.shape[:2]), np.ones(place.shape[:2])
        speed = np.tile([0.5, 0.0, 0.5 * rise - 0.03], (len(t), 1))
        seen = odometry._Feet(np.tile(speed[:, None], (1, 3, 1)), low, place, 0.0)
        where = odometry._on_the_ground(t, seen, speed, weight)
        np.testing.assert_allclose(where[:, 2], 0.3 + rise * where[:, 0], atol=4e-3)


@pytest.mark.parametrize("sensors", [("gyro", "accelerometer"), ("gyro", "orientation")])
def test_the_floor_carries_it(machine: Scene, whole: Recording, sensors: tuple[str, ...]) -> None:
    known = without_base(whole, *sensors)
    columns = known.columns | located(machine, "root", whole.t, known.columns)
    columns |= base.coordinates("root", columns)
    m, d = machine.model, mujoco.MjData(machine.model)
    carried = []
    for k in range(50, len(whole.t), 5):
        for kind, state in (("qpos", d.qpos), ("qvel", d.qvel)):
            state[:] = [columns[f"{kind}/{name}"][k] for name in machine.joints]
        d.ctrl[:] = [columns[f"ctrl/{name}"][k] for name in stool.JOINTS]
        mujoco.mj_forward(m, d)
        carried.append(d.qfrc_constraint[machine.dof("root/z")])
    weight = m.body_mass.sum() * 9.81
    assert np.mean(carried) == pytest.approx(weight, rel=0.15)


def test_replays_keep_beside_a_go2_that_walks(from_shared: FromShared) -> None:
    """With nothing hidden, as the runner of the package recorded it: 0.25 s at a time."""
    walk = from_shared("cases/field/17_go2_runner_imu_only.parquet")
    scene = Scene(from_shared("cases/field/17_go2.xml"))
    fitted = smooth(scene, prepare(scene, [walk], []).fit)
    pairs = stretches_of(fitted, forgets=False, seconds=2.0)
    said = Replayer(scene, [stretch for stretch, _ in pairs], 1e-3).run([()]).q[0]
    measured = np.concatenate([q for _, q in pairs])
    legs = np.isfinite(measured).all(axis=0)
    error = np.sqrt(np.mean((said - measured)[:, legs] ** 2, axis=0))
    assert legs.sum() == 12
    assert (error < 0.1 * np.std(measured[:, legs], axis=0)).all()


def test_a_recorded_base_is_not_computed(machine: Scene, whole: Recording) -> None:
    assert located(machine, "root", whole.t, whole.columns) == {}


@pytest.mark.parametrize("sensors", [(), ("gyro",), ("accelerometer", "orientation")])
def test_too_little_is_said_to_be(
    machine: Scene, whole: Recording, sensors: tuple[str, ...]
) -> None:
    known = without_base(whole, *sensors)
    with pytest.raises(RecordingError, match=r"qpos/root/0…6, or a gyro and an accelerometer"):
        prepare(machine, [known], [])


def test_replays_are_not_compared_with_what_an_estimator_says(
    machine: Scene, whole: Recording
) -> None:
    known = without_base(whole, *SENSORS)
    free = [machine.dof(name) for name in base.names("root")]
    for recording, compared in ((known, False), (whole, True)):
        fitted = smooth(machine, prepare(machine, [recording], []).fit)
        for _, measured in stretches_of(fitted, forgets=False):
            assert np.isfinite(measured[:, free]).any() == compared
            assert np.isfinite(np.delete(measured, free, axis=1)).all()


@pytest.mark.long
def test_a_load_is_seen_by_an_imu(machine: Scene) -> None:
    edit = stool.loaded(1.0, (0.08, -0.03, 0.06))
    recorded = [stool.recording(seed, edit, seconds=5.0, imu=SENSORS) for seed in (3, 4)]
    first, second = (without_base(r, "gyro", "accelerometer") for r in recorded)
    prepared = prepare(machine, [first], [second])
    best = Screen(smooth(machine, [*prepared.fit, *prepared.held])).rank([])[0]
    assert (best.planted.effect.id, best.planted.at.name) == ("body.payload_fixed", "trunk")
    assert best.planted.theta[0] == pytest.approx(1.0, abs=0.4)


def test_a_translation_sees_the_base_move(machine: Scene, whole: Recording) -> None:
    """The second half, while it shuffles about: turning as the gyro says, up as it was."""
    channels = [Channel(f"{kind}/{axis}", "1") for kind in ("gyro", "gravity") for axis in "xyz"]
    action = [Channel(f"ctrl/{stool.JOINTS[0]}", "rad")]
    observer = Observer(machine, channels, action, 50.0)

    def seen(recording: Recording) -> np.ndarray:
        part, *_ = prepare(machine, [recording], []).fit
        state = observer.states(part.recording)
        return observer.seen(channels, state, state.ctrl)[len(state.t) // 2 :]

    true, found = seen(whole), seen(without_base(whole, "gyro", "orientation"))
    assert (np.std(true, axis=0)[[0, 1, 3, 4]] > 0.005).all()
    assert np.std(found - true, axis=0) == pytest.approx(np.zeros(6), abs=0.003)
