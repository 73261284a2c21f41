"""What an arm runs into: seen in forces, placed by the shape of its links, and replayed."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics import arm
from tests.physics.laws import BEFORE_TABLE, LEVEL
from wt.physics.effect import effects
from wt.physics.hits import face
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.types import Location

WALL = effects()["contact.obstacle"]
AT = Location("world", "world")


@pytest.fixture(scope="module")
def run() -> arm.Run:
    return arm.simulate(BEFORE_TABLE, seconds=4.0)


def moved(folder: Path, run: arm.Run) -> Motion:
    """Every tenth sample, with the noise that forces have in recordings."""
    rng, some = np.random.default_rng(0), slice(None, None, 10)
    a = run.a[some] + 0.5 * rng.normal(size=run.a[some].shape)
    thin = arm.Run(run.t[some], run.held[some], run.q[some], run.v[some], a)
    return arm.motion(arm.scene(folder), thin)


@pytest.mark.long
def test_the_table_is_seen_where_it_is(run: arm.Run, tmp_path: Path) -> None:
    found = face(moved(tmp_path, run))
    assert found is not None
    assert found.normal == pytest.approx((0.0, 0.0, 1.0), abs=0.03)
    # the link that touches it is not the hand that is fixed to it, on which forces fit as well
    assert found.position[2] == pytest.approx(LEVEL, abs=0.002)


def test_nothing_is_seen_where_nothing_is(tmp_path: Path) -> None:
    assert face(moved(tmp_path, arm.simulate(arm.ARM, seconds=2.0))) is None
    # a joint that rubs is no wall
    rubbing = arm.edited(('<joint name="j1" axis="0 1 0"', (
        '<joint name="j1" frictionloss="2" axis="0 1 0"')))  # fmt: skip
    assert face(moved(tmp_path, arm.simulate(rubbing, seconds=2.0))) is None


def test_replays_stop_at_the_table(run: arm.Run, tmp_path: Path) -> None:
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    there = Planted(WALL, AT, np.array([0.3, 0.0, LEVEL, 0.0, 0.0, 1.0, 0.3]))
    q = Replayer(arm.scene(tmp_path), [stretch]).run([(), (there,)]).q
    free, stopped = np.sqrt(np.mean((q - run.q) ** 2, axis=(1, 2)))
    assert stopped < 0.15 * free


def test_the_patch_is_plain_mjcf_and_leaves_other_contacts(tmp_path: Path) -> None:
    spec = arm.scene(tmp_path).spec()
    WALL.patch(spec, AT, np.array([0.3, 0.1, 0.4, 0.0, 0.6, 0.8, 0.5]))
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    box = model.geom("obstacle")
    face_at = box.pos + 0.1 * np.array([0.0, 0.6, 0.8])
    assert face_at == pytest.approx([0.3, 0.1, 0.4], abs=1e-5)
    assert not box.contype[0] & 1
    assert box.friction[0] == pytest.approx(0.5) and box.priority[0] == 1
    assert [bool(model.geom(f"g{i}").conaffinity[0] & box.contype[0]) for i in range(4)] == [
        False, True, True, True
    ]  # fmt: skip
    assert model.geom("g2").conaffinity[0] & 1


def test_people_are_told() -> None:
    assert [(p.name, p.unit) for p in WALL.parameters] == [
        ("position", "m"), ("normal", "-"), ("friction", "-")
    ]  # fmt: skip
    theta = np.array([0.3, 0.1, 0.4, 0.0, 0.0, 1.0, 0.5])
    assert "0.3, 0.1, 0.4 m" in WALL.statement(AT, theta)
    assert WALL.separation(AT)
