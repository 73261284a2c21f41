from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import chain, on_joint, record, world
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.locate import locate
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

J2 = Location("joint", "j2")


def test_nothing_is_located_without_a_mismatch(tmp_path: Path) -> None:
    assert locate(world(tmp_path, 2, None).screen, (), []) == ()


def test_a_detent_is_located_in_position_and_time(tmp_path: Path) -> None:
    w = world(
        tmp_path, 2, on_joint(1, lambda q, v: float(-3.0 * np.exp(-(((q - 0.7) / 0.1) ** 2))))
    )
    (place,) = locate(w.screen, (), [], unexplained={"j2": 1.0})
    assert (place.at, place.share) == (J2, 1.0)
    assert place.condition.startswith("near ")
    assert float(place.condition.split()[1]) == pytest.approx(0.7, abs=0.1)
    assert 1 <= len(place.intervals) <= 10
    assert {i.recording for i in place.intervals} == {"recording 1"}
    t, q = w.screen.motion.t, w.screen.motion.q[:, 1]
    said = np.any([(t >= i.start) & (t <= i.end) for i in place.intervals], axis=0)
    # whenever the force is strong it is inside, and most of the rest is outside
    assert said[np.abs(q - 0.7) < 0.08][50:-50].mean() > 0.95
    assert said[np.abs(q - 0.7) > 0.35].mean() < 0.35


@pytest.mark.parametrize(
    ("effect", "theta", "condition"),
    [
        ("joint.friction_viscous", [0.6], "at speeds above "),
        ("joint.friction_coulomb", [0.5], ""),
    ],
)
def test_condition_of_a_named_effect(
    tmp_path: Path, effect: str, theta: list[float], condition: str
) -> None:
    law = {
        "joint.friction_viscous": lambda q, v: -0.6 * v,
        "joint.friction_coulomb": lambda q, v: float(-0.5 * np.tanh(v / 0.002)),
    }[effect]
    w = world(tmp_path, 2, on_joint(1, law))
    hypothesis = (Planted(effects()[effect], J2, np.array(theta)),)
    (place,) = locate(w.screen, hypothesis, [0.4])
    assert (place.at, place.share) == (J2, 1.0)
    assert place.condition.startswith(condition)
    assert bool(place.condition) == bool(condition)


def test_direction_is_a_condition(tmp_path: Path) -> None:
    w = world(tmp_path, 2, on_joint(1, lambda q, v: -0.8 * (v > 0.0)))
    (place,) = locate(w.screen, (), [], unexplained={"j2": 1.0})
    assert place.condition == "when moving in the positive direction"


def test_shares_of_named_and_unexplained_places_sum_to_one(tmp_path: Path) -> None:
    def hidden(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[0] -= 0.6 * data.qvel[0]
        data.qfrc_applied[1] -= 0.5 * np.tanh(data.qvel[1] / 0.002)

    w = world(tmp_path, 2, hidden)
    viscous = Planted(effects()["joint.friction_viscous"], Location("joint", "j1"), np.array([0.6]))
    places = locate(w.screen, (viscous,), [0.9], unexplained={"j2": 0.3})
    assert [(p.at.name, round(p.share, 6)) for p in places] == [("j1", 0.7), ("j2", 0.3)]


def test_a_push_on_a_body_is_not_blamed_on_its_joints(tmp_path: Path) -> None:
    def push(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.xfrc_applied[5, :3] = (6.0, -4.0, 3.0) if 3.0 < data.time < 7.0 else 0.0

    w = world(tmp_path, 5, push)
    (place,) = locate(w.screen, (), [], unexplained={f"j{i}": 0.2 for i in range(1, 6)})
    assert place.at == Location("body", "link5")
    start, end = place.intervals[0].start, place.intervals[-1].end
    assert (start, end) == (pytest.approx(3.0, abs=0.15), pytest.approx(7.0, abs=0.15))


def test_tilted_gravity_is_the_world(tmp_path: Path) -> None:
    def lean(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        # 4 degrees of tilt: a sideways acceleration of every body
        data.xfrc_applied[1:, 0] = 0.7 * model.body_mass[1:]

    w = world(tmp_path, 4, lean)
    (place,) = locate(w.screen, (), [], unexplained={"j1": 0.5, "j3": 0.5})
    assert place.at == Location("world", "world")


def test_a_cable_over_two_joints_is_a_pair(tmp_path: Path) -> None:
    def cable(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        pull = 4.0 * max(0.0, float(data.qpos[1] + 0.8 * data.qpos[2] - 0.6))
        data.qfrc_applied[1] -= pull
        data.qfrc_applied[2] -= 0.8 * pull

    w = world(tmp_path, 3, cable)
    (place,) = locate(w.screen, (), [], unexplained={"j2": 0.5, "j3": 0.5})
    assert place.at == Location("pair", "j2+j3")


def test_a_fault_that_shows_in_no_force_stays_with_its_joint(tmp_path: Path) -> None:
    (place,) = locate(world(tmp_path, 2, None).screen, (), [], unexplained={"j1": 1.0})
    assert (place.at, place.condition) == (Location("joint", "j1"), "")


def test_intervals_say_which_recording_they_are_of(tmp_path: Path) -> None:
    def push(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[1] += 3.0 * (4.0 < data.time < 5.0)

    path = tmp_path / "chain.xml"
    path.write_text(chain(2), encoding="utf-8")
    # nothing is hidden in the first of three recordings
    parts = [Part(record(chain(2), push if seed else None, 8.0, seed), seed) for seed in range(3)]
    screen = Screen(smooth(Scene(path), parts), 0)
    names = ("a.parquet", "b.parquet", "c.parquet")
    (place,) = locate(screen, (), [], unexplained={"j2": 1.0}, names=names)
    spans = [(i.recording, i.start, i.end) for i in place.intervals]
    assert [name for name, *_ in spans] == ["b.parquet", "c.parquet"]
    for _, start, end in spans:
        assert (start, end) == (pytest.approx(4.0, abs=0.15), pytest.approx(5.0, abs=0.15))
    # those without a name are of one recording
    assert place.to_json()["intervals_s"] == [list(spans[0][1:])]
    by_name = {x["recording"]: x["intervals_s"] for x in place.to_json()["intervals"]}
    assert by_name == {name: [[start, end]] for name, start, end in spans}


def test_recordings_of_one_name_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "chain.xml"
    path.write_text(chain(2), encoding="utf-8")
    one, plain, two, three = (record(chain(2), None, 4.0, seed) for seed in range(4))
    named = [Recording(r.t, r.columns, {"source": "bench"}) for r in (one, two, three)]
    prepared = prepare(Scene(path), [named[0], plain, named[1]], [named[2]])
    assert prepared.names == ("bench", "recording 2", "bench (2)", "bench (3)")
    assert [u.path for u in prepared.used] == list(prepared.names)
