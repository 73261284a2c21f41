"""Windows begin where the smooth curve is the motion: not in a jolt of the commands."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import BURN_IN_S, WINDOW_S, stretches_of
from wt.physics.scene import Scene
from wt.types import Recording

CHAIN = """\
<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body><joint name="j1" axis="0 1 0" damping=".1"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass=".8"/>
<body pos="0 0 -.3"><joint name="j2" axis="1 0 0" damping=".1"/>
<geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03" mass=".5"/></body></body></worldbody>
<actuator><motor name="a1" joint="j1"/><motor name="a2" joint="j2"/></actuator></mujoco>
"""
STIFF, DAMPED = np.array([30.0, 15.0]), np.array([1.5, 0.75])
RATE, EVERY, NOISE, SECONDS = 100, 20, 1e-3, 12.0


def steps(
    height: float = 0.3, noise: float = NOISE, rate: int = RATE
) -> tuple[Recording, np.ndarray]:
    """A torque loop around steps of its goal that fall on starts of windows, and its true speed."""
    model = mujoco.MjModel.from_xml_string(CHAIN)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    t = np.arange(int(SECONDS * rate)) / rate
    goal = 0.3 * np.sin(t[:, None] * [1.7, 2.3]) + height * (np.floor(t / 1.0) % 2)[:, None]
    q, v, u = (np.zeros((len(t), 2)) for _ in range(3))
    for k in range(len(t)):
        q[k], v[k] = data.qpos, data.qvel
        u[k] = STIFF * (goal[k] - q[k]) - DAMPED * v[k]
        data.ctrl[:] = u[k]
        mujoco.mj_step(model, data, EVERY * RATE // rate)
    noisy = q + noise * rng.standard_normal(q.shape)
    columns = {f"qpos/j{i + 1}": noisy[:, i] for i in range(2)}
    return Recording(t, columns | {f"ctrl/a{i + 1}": u[:, i] for i in range(2)}), v


def test_they_begin_on_the_true_motion(tmp_path: Path) -> None:
    recording, true = steps()
    path = tmp_path / "chain.xml"
    path.write_text(CHAIN)
    smoothed = smooth(Scene(path), [Part(recording, 0)])
    windows = [s for s, _ in stretches_of(smoothed, forgets=False)]
    assert len(windows) > 0.8 * SECONDS / WINDOW_S
    off = [np.abs(s.v0 - true[round(s.t[0] * RATE)]) / s.unsure[2:] for s in windows]
    assert np.max(off) < 6.0
    jumps, knot = np.arange(1.0, SECONDS), max(smoothed.spacing[0]) / RATE
    assert min(np.abs(jumps - s.t[0]).min() for s in windows) >= knot
    # nor at the loose end of the curve
    assert windows[0].t[0] >= 3.0 * knot - 1e-9
    # most of each window is kept
    assert np.median([s.t[-1] - s.t[0] for s in windows]) > 0.8 * WINDOW_S


def test_a_window_is_as_unsure_as_its_own_recording_is(tmp_path: Path) -> None:
    """A curve that follows steps follows noise; beside one that need not, it is off by far more.

    The drives of the model are weak, so that it does not say what the steps do.
    """
    path, made = tmp_path / "chain.xml", [steps(0.0), steps()]
    path.write_text(CHAIN.replace("<motor", '<motor gear=".01"'))
    smoothed = smooth(Scene(path), [Part(recording, i) for i, (recording, _) in enumerate(made)])
    windows = [s for s, _ in stretches_of(smoothed, forgets=False)]
    unsure = []
    for i, (_, true) in enumerate(made):
        own = [s for s in windows if s.recording == i]
        off = [(s.v0 - true[round(s.t[0] * RATE)]) / s.unsure[2:] for s in own]
        assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.8
        unsure.append(own[0].unsure[2:].max())
    assert unsure[1] > 2.0 * unsure[0]


def test_commands_that_change_all_the_time_hold_nothing_back(tmp_path: Path) -> None:
    recording, _ = steps()
    rng = np.random.default_rng(1)
    busy = recording.columns["ctrl/a1"] + rng.standard_normal(len(recording.t))
    path = tmp_path / "chain.xml"
    path.write_text(CHAIN)
    columns = recording.columns | {"ctrl/a1": busy, "ctrl/a2": busy}
    smoothed = smooth(Scene(path), [Part(Recording(recording.t, columns), 0)])
    windows = [s for s, _ in stretches_of(smoothed, forgets=False)]
    assert np.median([s.t[-1] - s.t[0] for s in windows]) > 0.95 * (WINDOW_S - 1.0 / RATE)


def test_short_blocks_of_all_of_a_recording_score_each_sample_once(tmp_path: Path) -> None:
    recording, _ = steps(0.0)
    path = tmp_path / "chain.xml"
    path.write_text(CHAIN)
    smoothed = smooth(Scene(path), [Part(recording, 0)])
    blocks = [s for s, _ in stretches_of(smoothed, forgets=True, window=2.5)]
    assert len(blocks) == 5
    scored = np.concatenate([s.t[s.t >= s.t[0] + BURN_IN_S] for s in blocks])
    np.testing.assert_allclose(scored, recording.t[-len(scored) :])
    assert len(scored) > 0.95 * SECONDS * RATE
    ((one, _),) = stretches_of(smoothed, forgets=True)
    assert one.t[-1] == recording.t[-1]
    few = [s for s, _ in stretches_of(smoothed, forgets=True, seconds=6.0, window=2.5)]
    assert len(few) == 3
    assert 5.0 < sum(s.t[-1] - s.t[0] for s in few) < 6.0
