"""Suggested motions keep the robot's limits and tell apart what the recordings could not."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose import synthetic
from wt.data import recording as recordings
from wt.diagnose.experiment import signals
from wt.diagnose.experiment.excite import suggest
from wt.diagnose.result import Diagnosis
from wt.errors import RecordingError, WorkError
from wt.types import Recording

NOISE = 2e-4  # rad
STEP = 5e-4
HANGING = (
    synthetic.ARM.replace('integrator="implicitfast"', 'gravity="0 0 9.81"')
    .replace('<position name="a1" joint="j1" kp="120" kv="6"/>', '<motor name="a1" joint="j1"/>')
    .replace('<position name="a2" joint="j2" kp="60" kv="3"/>', '<motor name="a2" joint="j2"/>')
    .replace('damping=".5"', 'damping=".5" limited="true" range="-2 2"')
)


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return synthetic.write_model(tmp_path)


@pytest.fixture(scope="module")
def suggested(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """The motion that tells the arm's rivals apart."""
    return suggest(
        synthetic.diagnosis(), synthetic.write_model(tmp_path_factory.mktemp("suggested"))
    )


def replay(
    model: mujoco.MjModel, u: np.ndarray, q0: np.ndarray, delay: float, lag: float
) -> np.ndarray:
    """Position of j2 under commands (T, 2), the second late and behind a first-order lag."""
    data = mujoco.MjData(model)
    data.qpos[:] = q0
    each = round(1.0 / (synthetic.RATE * STEP))
    held = np.repeat(u, each, axis=0)
    t = np.arange(len(held)) * STEP
    late = np.interp(t - delay, t, held[:, 1])
    behind, q = late[0], np.empty(len(u))
    for i, command in enumerate(late):
        behind += STEP / lag * (command - behind)
        if i % each == 0:
            q[i // each] = data.qpos[1]
        data.ctrl[:] = held[i, 0], behind
        mujoco.mj_step(model, data)
    return q


def deviations(u: np.ndarray, q0: np.ndarray, first: str, second: str) -> np.ndarray:
    """Cramér-Rao bounds of two parameters from 30 s of such a recording, by finite differences."""
    truth = {"coulomb": 0.8, "viscous": 0.0, "delay": 4e-3, "lag": 4e-3}
    change = {"coulomb": 0.04, "viscous": 0.05, "delay": 2e-3, "lag": 2e-3}

    def response(**values: float) -> np.ndarray:
        all_of = truth | values
        model = mujoco.MjModel.from_xml_string(synthetic.ARM)
        dof = model.joint("j2").dofadr[0]
        model.dof_frictionloss[dof] += all_of["coulomb"]
        model.dof_damping[dof] += all_of["viscous"]
        return replay(model, u, q0, all_of["delay"], all_of["lag"])

    base = response()
    jacobian = np.stack(
        [(response(**{p: truth[p] + change[p]}) - base) / change[p] for p in (first, second)], 1
    )
    information = jacobian.T @ jacobian / NOISE**2 * (30.0 * synthetic.RATE / len(u))
    return np.sqrt(np.diag(np.linalg.inv(information)))


@pytest.mark.long
def test_confusable_pairs_come_apart(suggested: Recording) -> None:
    """The same seconds of the suggested motion tell more than those of the recorded one."""
    diagnosis = synthetic.diagnosis()
    recorded = np.stack([diagnosis.traces[1].command[a] for a in ("a1", "a2")], axis=1)
    new = suggested
    u = np.stack([new.columns["ctrl/a1"], new.columns["ctrl/a2"]], axis=1)
    q0 = np.array([new.columns["qpos/j1"][0], new.columns["qpos/j2"][0]])
    for pair, factor in ((("delay", "lag"), 5.0), (("viscous", "delay"), 2.0)):
        before = deviations(recorded, np.zeros(2), *pair)
        after = deviations(u, q0, *pair)
        assert (after < before / factor).all(), (pair, before, after)
    before = deviations(recorded, np.zeros(2), "coulomb", "viscous")
    after = deviations(u, q0, "coulomb", "viscous")
    assert after[1] < before[1] / 1.5 and after[0] < 1.3 * before[0]


def test_only_joints_with_rivals_move_and_from_rest_to_rest(suggested: Recording) -> None:
    motion = suggested
    assert motion.seconds == pytest.approx(30.0) and motion.rate_hz == pytest.approx(100.0)
    q1, q2 = motion.columns["qpos/j1"], motion.columns["qpos/j2"]
    assert np.ptp(q2) > 1.0 and np.ptp(q1) < 0.1
    for command in (motion.columns["ctrl/a1"], motion.columns["ctrl/a2"]):
        assert command[-1] == pytest.approx(command[0], abs=1e-6)
        assert np.abs(np.diff(command[:20])).max() < 1e-3
        assert np.abs(np.diff(command[-20:])).max() < 1e-3
    assert np.abs(q2[:5] - q2[0]).max() < 1e-3  # it starts where its command holds it


def test_without_rivals_all_joints_move_a_little_by_different_frequencies(arm: Path) -> None:
    motion = suggest(synthetic.nothing(), arm)
    commands = [motion.columns[f"ctrl/{a}"] for a in ("a1", "a2")]
    assert all(0.1 < np.ptp(c) < 0.8 for c in commands)
    assert abs(np.corrcoef(*commands)[0, 1]) < 0.8


def test_limits_of_joints_commands_and_recorded_speed_hold(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        synthetic.ARM.replace(
            'name="j2" axis="0 1 0" damping=".5"',
            'name="j2" axis="0 1 0" damping=".5" limited="true" range="-0.4 0.6"',
        ).replace('name="a2"', 'name="a2" ctrlrange="-0.3 1" forcerange="-8 8"')
    )
    diagnosis = synthetic.diagnosis()
    motion = suggest(diagnosis, path)
    q, u = motion.columns["qpos/j2"], motion.columns["ctrl/a2"]
    assert q.min() > -0.4 and q.max() < 0.6 and np.ptp(q) > 0.4
    assert u.min() >= -0.3 and u.max() <= 1.0
    fastest = max(np.quantile(np.abs(t.velocity[:, 1]), 0.995) for t in diagnosis.traces)
    assert np.abs(np.gradient(q, motion.t)).max() < 1.31 * fastest


def test_a_joint_that_would_hit_something_moves_less(suggested: Recording, tmp_path: Path) -> None:
    wall = '<geom name="wall" type="box" pos="0.45 0 0.28" size="0.3 0.3 0.02"/>'
    path = tmp_path / "walled.xml"
    path.write_text(synthetic.ARM.replace('<body name="base"', wall + '<body name="base"'))
    walled = suggest(synthetic.diagnosis(), path)
    assert np.ptp(walled.columns["qpos/j2"]) < 0.9 * np.ptp(suggested.columns["qpos/j2"])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for q in np.stack([walled.columns["qpos/j1"], walled.columns["qpos/j2"]], axis=1):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        geoms = data.contact.geom[data.contact.dist < 0.0]
        assert not (geoms == model.geom("wall").id).any()


def test_torque_motors_swing_a_little_around_the_pose_where_gravity_leaves_them(
    tmp_path: Path,
) -> None:
    path = tmp_path / "hanging.xml"
    path.write_text(HANGING)
    motion = suggest(synthetic.nothing(), path, rate_hz=200.0)
    q = np.stack([motion.columns["qpos/j1"], motion.columns["qpos/j2"]], axis=1)
    # at rest no torque is needed, in the pose of equal moments
    assert abs(motion.columns["ctrl/a1"][0]) < 0.05 and abs(motion.columns["ctrl/a2"][0]) < 0.05
    assert (np.ptp(q, axis=0) > 0.05).all() and (np.ptp(q, axis=0) < 0.8).all()
    assert np.abs(q).max() < 2.0


def test_no_room_is_an_error_that_says_so(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        synthetic.ARM.replace('kp="60" kv="3"', 'kp="60" kv="3" forcerange="-0.01 0.01"')
    )
    with pytest.raises(WorkError, match="bodies base and fore touch; record from a pose"):
        suggest(synthetic.diagnosis(), path, seconds=10.0)


def test_a_motion_that_is_too_short_is_refused(arm: Path) -> None:
    with pytest.raises(RecordingError, match="at least 10 s"):
        suggest(synthetic.diagnosis(), arm, seconds=5.0)


def test_the_suggestion_is_a_recording_of_the_robot(arm: Path, tmp_path: Path) -> None:
    motion = suggest(synthetic.diagnosis(), arm, seconds=12.0, seed=3)
    recordings.write(motion, tmp_path / "next.parquet")
    read = recordings.read(tmp_path / "next.parquet")
    recordings.check_against(read, mujoco.MjModel.from_xml_path(str(arm)))
    assert "not measured" in str(read.meta["notes"])
    same = suggest(synthetic.diagnosis(), arm, seconds=12.0, seed=3)
    other = suggest(synthetic.diagnosis(), arm, seconds=12.0, seed=4)
    np.testing.assert_array_equal(same.columns["ctrl/a2"], motion.columns["ctrl/a2"])
    assert np.abs(other.columns["ctrl/a2"] - motion.columns["ctrl/a2"]).max() > 0.01


def without_traces(diagnosis: Diagnosis) -> Diagnosis:
    return dataclasses.replace(diagnosis, traces=())


def test_what_was_never_seen_moving_moves_mildly(arm: Path) -> None:
    motion: Recording = suggest(without_traces(synthetic.diagnosis()), arm)
    q = motion.columns["qpos/j2"]
    assert 0.1 < np.ptp(q) < 0.8
    assert np.abs(np.gradient(q, motion.t)).max() < 0.4


def test_reversals_have_one_speed_and_return() -> None:
    x = signals.reversals(1000, 0.01, 0.2, 0.3)
    speed = np.abs(np.diff(x)) / 0.01
    assert np.mean(np.isclose(speed, 0.2, rtol=0.02)) > 0.97
    assert np.abs(x).max() <= 0.3 and abs(x[-1]) < 0.01 and x[0] == 0.0
    assert np.sum(np.diff(np.sign(np.diff(x))) != 0) >= 4


def test_a_multisine_has_flat_speed_in_its_band_and_low_peaks() -> None:
    n, dt = 4000, 0.005
    x = signals.multisine(n, dt, 1.0, 10.0, (0.5, 5.0))
    v = np.gradient(x, dt)
    assert np.abs(v).max() == pytest.approx(1.0)
    power = np.abs(np.fft.rfft(v)) ** 2
    f = np.fft.rfftfreq(n, dt)
    inside = (f > 0.4) & (f < 5.4)
    assert power[inside].sum() > 0.98 * power.sum()
    # a sum of twelve sines in phase would have a crest of 4.9
    assert np.abs(v).max() / np.sqrt(np.mean(v[n // 5 : -n // 5] ** 2)) < 3.2


def test_holds_stand_still_at_both_ends_of_the_reach() -> None:
    x = signals.holds(2000, 0.01, 0.6, 0.6)
    still = np.isclose(np.diff(x), 0.0)
    for angle in (-0.6, 0.0, 0.6):
        assert np.sum(still & np.isclose(x[1:], angle)) > 50
    assert np.abs(np.diff(x)).max() / 0.01 < 0.61
    assert x[-1] == 0.0


def test_signals_keep_their_speed_however_little_time_there_is() -> None:
    dt, speed = 0.01, 0.3
    for n in (250, 700):
        for x in (
            signals.holds(n, dt, speed, 5.0),
            signals.steps(n, dt, speed, 5.0, np.random.default_rng(1)),
            signals.reversals(n, dt, speed, 5.0),
            signals.multisine(n, dt, speed, 5.0, (0.1, 8.0)),
        ):
            assert len(x) == n
            assert np.abs(np.diff(x, prepend=0.0, append=0.0)).max() / dt < 1.05 * speed
