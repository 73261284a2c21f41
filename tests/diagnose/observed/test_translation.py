"""What a translation says of recordings: a pendulum that is pushed, seen step by step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.worlds.walking.test_concealed import QUICK, to_xml
from tests.worlds.walking.test_world import world
from wt.diagnose.evidence import Interval
from wt.diagnose.observed.observer import Observer
from wt.diagnose.observed.translation import (
    TrainedTranslation,
    sentences,
    timed,
    translated,
)
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.result import Located
from wt.errors import ModelError, RecordingError
from wt.physics.scene import Scene
from wt.types import Channel, Location, Recording

RATE = 50.0
PUSHED = (2.0, 2.3)
ARM = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 1 0" damping="0.1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03" mass="1"/></body></worldbody>
  <actuator><position name="m" joint="j" kp="20" kv="2"/></actuator></mujoco>"""
OBSERVATION = (
    Channel("qpos/j", "rad"),
    Channel("qvel/j", "rad/s"),
    Channel("last_action/m", "rad"),
)
ACTION = (Channel("ctrl/m", "rad"),)
Run = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def recorded(seconds: float = 6.0, drop: slice | None = None) -> Recording:
    """R: more friction than ARM has, and a push; 200 samples and 50 commands a second."""
    model = mujoco.MjModel.from_xml_string(ARM.replace('damping="0.1"', 'damping="0.3"'))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    rows = []
    for k in range(int(seconds * 500)):
        t = k * 0.002
        if k % 10 == 0:
            data.ctrl[0] = np.sin(2 * t) + 0.3 * np.sin(7 * t)
        if k % 5 == 0:
            rows.append((t, *data.qpos, *data.qvel, *data.ctrl))
        data.qfrc_applied[0] = 4.0 if PUSHED[0] <= t < PUSHED[1] else 0.0
        mujoco.mj_step(model, data)
    t, q, v, u = np.array(rows).T
    q, v = q + rng.normal(0, 1e-5, len(t)), v + rng.normal(0, 1e-4, len(t))
    if drop is not None:
        q[drop] = v[drop] = np.nan
    return Recording(t, {"qpos/j": q, "qvel/j": v, "ctrl/m": u}, {"source": "pushed"})


def plain(
    o: np.ndarray, a: np.ndarray, o_next: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Translates nothing; its features are the outcome's change."""
    change = o_next[:, :2] - o[:, :2]
    return o_next, change, change


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "arm.xml").write_text(ARM)
    return Scene(tmp_path / "arm.xml")


def translation(
    run: Run = plain, observation: tuple[Channel, ...] = OBSERVATION
) -> TrainedTranslation:
    return TrainedTranslation("wt-arm/1", RATE, observation, ACTION, run)


def test_a_push_stands_out_when_it_acts(scene: Scene) -> None:
    prepared = prepare(scene, [recorded()], [])
    found = translated(scene, prepared, translation())
    (event,) = found.events
    assert event.recording == "pushed"
    assert event.start == pytest.approx(PUSHED[0], abs=0.08)
    assert event.end == pytest.approx(PUSHED[1], abs=0.08)
    assert [c.name for c in found.channels] == ["qpos/j", "qvel/j"]
    assert found.left == pytest.approx(1.0)
    assert all("wt-arm/1" in s or "once" in s for s in sentences(found))


def test_what_translation_leaves_is_what_the_model_lacks(scene: Scene) -> None:
    """A translation that knows R's friction leaves the push and nothing else."""
    real = mujoco.MjModel.from_xml_string(ARM.replace('damping="0.1"', 'damping="0.3"'))

    def knows(
        o: np.ndarray, a: np.ndarray, o_next: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        data, out = mujoco.MjData(real), o_next.copy()
        for k, (row, u) in enumerate(zip(o, a, strict=True)):
            data.qpos[0], data.qvel[0], data.ctrl[0] = row[0], row[1], u[0]
            for _ in range(10):
                mujoco.mj_step(real, data)
            out[k, 0], out[k, 1] = data.qpos[0], data.qvel[0]
        return out, out[:, :2], out[:, :2]

    everything = prepare(scene, [recorded()], [])
    assert 0.5 < translated(scene, everything, translation(knows)).left < 1.0
    calm = recorded()
    quiet = calm.t > PUSHED[1] + 0.1
    after = Recording(calm.t[quiet], {n: c[quiet] for n, c in calm.columns.items()}, calm.meta)
    assert translated(scene, prepare(scene, [after], []), translation(knows)).left < 0.01


def test_nothing_is_said_of_gaps(scene: Scene) -> None:
    recording = recorded(drop=slice(300, 340))
    (distance,) = translated(scene, prepare(scene, [recording], []), translation()).distances
    inside = (distance.t > recording.t[300]) & (distance.t < recording.t[338])
    assert not inside.any() and len(distance.t) > 240


def test_too_little_to_compare_is_refused(scene: Scene) -> None:
    recording = recorded(drop=slice(20, 1100))
    with pytest.raises(RecordingError, match=r"'pushed': only \d+ control steps at 50 Hz"):
        translated(scene, prepare(scene, [recording], []), translation())


@pytest.mark.parametrize(
    ("channel", "said"),
    [
        ("qpos/elbow", "of another robot: the model has nothing of the name 'elbow'"),
        ("gyro/x", "reads 'gyro', and nothing floats"),
        ("force/x", "reads 'force/x', which no recording has"),
    ],
)
def test_a_translation_of_another_robot_is_refused(scene: Scene, channel: str, said: str) -> None:
    other = translation(observation=(Channel(channel, "1"), *OBSERVATION[1:]))
    with pytest.raises(ModelError, match=said):
        translated(scene, prepare(scene, [recorded()], []), other)


def test_events_say_when_where_nothing_else_does(scene: Scene) -> None:
    found = translated(scene, prepare(scene, [recorded()], []), translation())
    own = (Interval("pushed", 1.0, 1.5),)
    first, second = (Located(Location("joint", name), 0.5) for name in ("j", "k"))
    assert timed([first, second], found) == (
        Located(first.at, 0.5, found.events), second,
    )  # fmt: skip
    known = Located(first.at, 0.5, own)
    assert timed([known], found) == (known,)
    assert timed([], found) == () and timed([first], None) == (first,)


def test_walks_are_seen_as_the_policy_sees_them(tmp_path: Path) -> None:
    """Recordings against the transitions that were collected from the same walks."""
    w = world("go2_concealed", **{**QUICK, "episode_steps": 110, "robots": 2})
    (tmp_path / "s.xml").write_text(to_xml(w))
    t = w.collect("real", 220, 5).select(np.arange(110))
    (recording,) = w.record(220, 5, 1)
    turned = dict(recording.columns)
    for k in range(3, 7):  # a quaternion's sign says nothing
        turned[f"qpos/base/{k}"] = turned[f"qpos/base/{k}"] * np.where(recording.t > 1.0, -1, 1)
    observer = Observer(Scene(tmp_path / "s.xml"), w.spec.observation, w.spec.action, 50.0)
    state = observer.states(Recording(recording.t, turned, {}))
    seen = observer.seen(w.spec.observation, state, np.vstack([state.ctrl[:1], state.ctrl[:-1]]))
    n = w.spec.n_state
    noise = np.array([c.unit in ("rad/s",) for c in w.spec.state])
    assert np.abs(seen[:, :n] - t.o[:, :n])[:, ~noise].max() < 8e-3
    assert np.abs(seen[:, :n] - t.o[:, :n])[:, noise].max() < 0.06
    np.testing.assert_allclose(seen[1:, n:], t.o[1:, n:], atol=1e-6)
    np.testing.assert_allclose(observer.seen(w.spec.action, state, state.ctrl), t.a, atol=1e-6)
    answer = observer.seen(w.spec.observation, observer.answer(state), state.ctrl)[:, :n]
    want = w.sim_step(t.o, t.a, t.hidden)
    size = t.s_next.std(axis=0)
    assert np.sqrt(np.median(((answer - want) / size) ** 2)) < 0.05
    assert np.mean(((answer - want) / size) ** 2) < 0.5 * np.mean(((want - t.s_next) / size) ** 2)
