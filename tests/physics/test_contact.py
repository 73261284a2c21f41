"""What contacts may supply is no evidence; what they carry is."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics import arm, stool
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.physics.contact import loads, touching
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.types import Location
from wt.worlds import go2_model

FOOT = Location("geom", "left_foot")
FLOOR = Location("geom", "floor")


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return stool.scene(tmp_path_factory.mktemp("stool"))


def moved(machine: Scene, edit: stool.Edit | None = None) -> Motion:
    return smooth(machine, [Part(stool.recording(0, edit, seconds=4.0), 0)]).motion


def standing(machine: Scene, height: float) -> np.ndarray:
    q = np.zeros((1, machine.model.nv))
    q[0, 2] = height
    return q


def test_feet_of_several_geoms_are_seen_before_they_touch(tmp_path: Path) -> None:
    path = tmp_path / "go2.xml"
    path.write_text(go2_model.spec(go2_model.PUBLISHED, 0.002).to_xml())
    go2 = Scene(path)
    q = np.array([[0.0, 0.0, go2_model.HEIGHT, 0.0, 0.0, 0.0, *go2_model.DEFAULT]])
    over, lifted = (q + lift * np.eye(go2.model.nv)[2] for lift in (0.01, 0.05))
    assert touching(go2, over).near[0] == 4
    assert touching(go2, lifted).near[0] == 0


def test_a_force_of_the_ground_is_not_free_and_others_partly_are(machine: Scene) -> None:
    q = standing(machine, stool.HEIGHT)
    found, model = touching(machine, q), machine.model
    assert found.near[0] == 3
    data, jacobian = mujoco.MjData(model), np.zeros((3, model.nv))
    data.qpos[:] = q[0]
    mujoco.mj_fwdPosition(model, data)
    foot = model.geom("left_foot")
    mujoco.mj_jac(model, data, jacobian, None, [0.18, 0.2, 0.0], int(foot.bodyid[0]))
    ground = jacobian.T @ np.array([3.0, -1.0, 20.0])
    assert np.abs(found.free(ground[None])).max() < 1e-3 * np.abs(ground).max()
    # what pulls on a trunk that stands on three feet is carried, what swings a leg is not all
    turn = np.zeros((1, model.nv, 2))
    turn[0, 6, 0], turn[0, 0, 1] = 1.0, 1.0
    left = found.free(turn)
    assert np.abs(left[0, :, 0]).max() > 0.02
    assert found.free(left) == pytest.approx(left, abs=1e-4)


def test_in_the_air_all_force_is_free(machine: Scene) -> None:
    found = touching(machine, standing(machine, 0.5))
    force = np.arange(12.0)[None]
    assert found.near[0] == 0
    assert found.free(force) is force


def test_the_feet_carry_the_weight(machine: Scene) -> None:
    motion = moved(machine)
    carried = [
        load.force[:, 0].sum()
        for load in loads(machine, motion.q[50::10], motion.v[50::10], motion.residual[50::10])
    ]
    weight = 9.81 * float(machine.model.body_mass.sum())
    assert np.median(carried) == pytest.approx(weight, rel=0.05)


def test_slipping_feet_show_how_slippery_the_floor_is(machine: Scene) -> None:
    effect = effects()["contact.friction"]
    starts = [effect.starts(moved(machine, stool.smooth_soles(mu)), FLOOR) for mu in (0.15, 0.6)]
    assert abs(starts[0][0][0] - 0.15) < 0.06
    assert not starts[1] or starts[1][0][0] > 0.25


def test_the_patch_rules_in_every_contact_of_its_geom(machine: Scene) -> None:
    effect = effects()["contact.friction"]
    assert {at.name for at in effect.places(machine)} == {
        "floor",
        *(f"{x}_foot" for x in stool.LEGS),
    }
    for at, others in ((FOOT, 1.0), (FLOOR, 0.2)):
        for priority in (0, 1):
            spec = machine.spec()
            for leg in stool.LEGS:
                spec.geom(f"{leg}_foot").priority = priority
            effect.patch(spec, at, np.array([0.2]))
            model = spec.compile()
            data = mujoco.MjData(model)
            data.qpos[2] = stool.HEIGHT - 1e-3
            mujoco.mj_forward(model, data)
            friction = {model.geom(max(c.geom)).name: c.friction[0] for c in data.contact}
            assert friction["left_foot"] == pytest.approx(0.2)
            assert friction["rear_foot"] == pytest.approx(others)


def test_people_are_told() -> None:
    effect = effects()["contact.friction"]
    assert [(p.name, p.unit) for p in effect.parameters] == [("friction", "-")]
    assert "floor" in effect.statement(FLOOR, np.array([0.2]))
    assert "floor" in effect.separation(FLOOR)


def test_a_machine_on_a_fixed_base_is_taken_to_touch_nothing(tmp_path: Path) -> None:
    floor = '<worldbody><geom name="floor" type="plane" size="2 2 0.1" pos="0 0 0.55"/>'
    fixed = arm.scene(tmp_path, arm.ARM.replace("<worldbody>", floor))
    assert touching(fixed, np.zeros((1, 3))).projector is None


def test_parts_close_to_each_other_are_no_contact(tmp_path: Path) -> None:
    path = tmp_path / "stool.xml"
    path.write_text(stool.STOOL.replace('contype="0"', "").replace('conaffinity="0"', ""))
    close = Scene(path)
    folded = standing(close, 1.0)
    folded[0, 7::2] = -2.8  # the shanks up to the trunk
    data = mujoco.MjData(close.model)
    data.qpos[:] = folded[0]
    mujoco.mj_forward(close.model, data)
    assert data.ncon > 0
    assert touching(close, folded).near[0] == 0


def test_what_floors_differ_by_is_no_finding(machine: Scene) -> None:
    motion = moved(machine)
    friction, softness = effects()["contact.friction"], effects()["contact.compliance"]
    for at in (FOOT, FLOOR):
        assert not friction.plausible(motion, at, np.array([0.9]))
        assert friction.plausible(motion, at, np.array([0.6]))
        assert not softness.plausible(motion, at, np.array([0.025]))
        assert softness.plausible(motion, at, np.array([0.04]))
