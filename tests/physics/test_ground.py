"""Where the ground is, read off the feet that stand still, and how it gives."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics import stool
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.contact import touching
from wt.physics.effect import effects
from wt.physics.ground import Floor
from wt.physics.planted import Planted
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

ANGLE, DIRECTION = 0.06, 2.0
FLOOR = Location("geom", "floor")
SLOPE, SOFT = effects()["contact.slope"], effects()["contact.compliance"]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return stool.scene(tmp_path_factory.mktemp("stool"))


def on_a_ramp(spec: mujoco.MjSpec) -> None:
    half, axis = 0.5 * ANGLE, (-np.sin(DIRECTION), np.cos(DIRECTION), 0.0)
    spec.geom("floor").quat = [np.cos(half), *(np.sin(half) * np.array(axis))]


def recorded(machine: Scene, edit: stool.Edit | None) -> Smoothed:
    return smooth(machine, [Part(stool.recording(0, edit, seconds=4.0), 0)])


def error(smoothed: Smoothed, *planted: Planted) -> float:
    """RMS of replays under a hypothesis."""
    pieces = stretches_of(smoothed, False)
    replayer = Replayer(smoothed.motion.scene, [s for s, _ in pieces], 1e-3)
    measured = np.concatenate([q for _, q in pieces])
    return float(np.sqrt(np.nanmean((replayer.run([planted]).q[0] - measured) ** 2)))


def test_a_ramp_is_seen_and_level_ground_is_let_be(machine: Scene) -> None:
    (floor,) = recorded(machine, on_a_ramp).motion.floors
    assert floor.angle == pytest.approx(ANGLE, abs=0.004)
    assert floor.direction == pytest.approx(DIRECTION, abs=0.08)
    assert abs(floor.height) < 0.005
    assert recorded(machine, None).motion.floors == ()


def test_replays_on_the_ramp_follow(machine: Scene) -> None:
    smoothed = recorded(machine, on_a_ramp)
    (start,) = SLOPE.starts(smoothed.motion, FLOOR)
    assert error(smoothed, Planted(SLOPE, FLOOR, start)) < 0.3 * error(smoothed)


def test_feet_on_a_ramp_are_still_taken_to_touch(machine: Scene) -> None:
    motion = recorded(machine, on_a_ramp).motion
    assert np.median(motion.touching.near) == 3
    above = [Floor(floor.geom, 0.0, 0.0, -1.0) for floor in motion.floors]
    assert not touching(machine, motion.q, above).near.any()


def test_the_patch_turns_the_plane_and_plain_mujoco_reads_it(machine: Scene) -> None:
    spec = machine.written()
    SLOPE.patch(spec, FLOOR, np.array([ANGLE, DIRECTION, 0.01]))
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    normal = data.geom("floor").xmat.reshape(3, 3)[:, 2]
    fall = np.array([np.cos(DIRECTION), np.sin(DIRECTION)]) * np.sin(ANGLE)
    assert normal == pytest.approx([*fall, np.cos(ANGLE)], abs=1e-5)
    assert data.geom("floor").xpos[2] == pytest.approx(0.01)


@pytest.mark.parametrize("place", ["floor", "left_foot"])
@pytest.mark.parametrize("priority", [0, 1])
def test_softness_holds_in_every_contact_of_its_geom(
    place: str, priority: int, machine: Scene
) -> None:
    spec = machine.spec()
    for leg in stool.LEGS:
        spec.geom(f"{leg}_foot").priority = priority
    SOFT.patch(spec, Location("geom", place), np.array([0.06]))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[2] = stool.HEIGHT - 1e-3
    mujoco.mj_forward(model, data)
    soft = {model.geom(max(c.geom)).name: c.solref[0] for c in data.contact}
    rub = {c.friction[0] for c in data.contact}
    assert soft["left_foot"] == pytest.approx(0.06)
    assert soft["rear_foot"] == pytest.approx(0.06 if place == "floor" else 0.02)
    assert rub == {1.0}


def test_people_are_told() -> None:
    assert SLOPE.parameters[0].unit == "rad" and SOFT.parameters[0].unit == "s"
    for one, values in ((SLOPE, (0.06, 2.0, 0.0)), (SOFT, (0.06,))):
        assert "floor" in one.statement(FLOOR, np.array(values))
        assert "floor" in one.separation(FLOOR)


def test_where_nothing_touches_there_is_nothing_to_give(tmp_path: Path) -> None:
    high = stool.STOOL.replace('<geom name="floor" type="plane" size="3 3 0.1"/>', (
        '<geom name="floor" type="plane" size="3 3 0.1" pos="0 0 -9"/>'))  # fmt: skip
    (tmp_path / "stool.xml").write_text(high)
    motion = recorded(Scene(tmp_path / "stool.xml"), None).motion
    assert SOFT.starts(motion, FLOOR) == []
    assert motion.floors == ()
