"""Units follow the joint: nothing of a slide is told in N·m or radians, whatever is said of it."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import scene
from wt.physics.effect import Effect, effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.physics.units import HINGE, SLIDE, column_unit, unit_at, units_at
from wt.types import Location

# A gantry: x and z slide, the wrist turns.
GANTRY = """<mujoco>
  <worldbody>
    <body name="beam"><joint name="x" type="slide" axis="1 0 0"/>
      <geom type="box" size=".1 .1 .1" mass="2"/>
      <body name="arm"><joint name="z" type="slide" axis="0 0 1"/>
        <geom type="box" size=".05 .05 .2" mass="1"/>
        <body name="hand"><joint name="wrist" axis="0 0 1"/>
          <geom type="box" size=".1 .02 .02" mass=".3"/></body></body></body>
  </worldbody>
  <actuator>
    <position name="mx" joint="x" kp="500" kv="50"/><motor name="mz" joint="z"/>
    <motor name="mw" joint="wrist"/>
  </actuator>
  <sensor>
    <jointpos name="ex" joint="x"/><jointvel name="ew" joint="wrist"/>
    <accelerometer name="imu" site="tip"/>
  </sensor>
</mujoco>""".replace(
    '<geom type="box" size=".1 .02', '<site name="tip"/><geom type="box" size=".1 .02'
)
TURNING = re.compile(r"rad|N·m|kg·m²|°|torque|angle|\brev\b|turn", re.IGNORECASE)
OF_JOINTS = [e for e in effects().values() if e.kind in ("joint", "actuator", "sensor")]


@pytest.fixture
def gantry(tmp_path: Path) -> Scene:
    return scene(tmp_path, GANTRY)


def middle(effect: Effect) -> np.ndarray:
    """Some parameters that are admissible."""
    return np.clip(np.full(effect.n_theta, 0.0123), *effect.bounds())


def slides(effect: Effect) -> Location:
    """Where it stands at a slide."""
    return Location(effect.kind, {"actuator": "mx", "sensor": "ex"}.get(effect.kind, "x"))


@pytest.mark.parametrize("effect", OF_JOINTS, ids=lambda e: e.id)
def test_nothing_of_a_slide_is_told_as_of_a_hinge(effect: Effect, gantry: Scene) -> None:
    at = slides(effect)
    for p in effect.parameters:
        unit = p.unit_in(units_at(gantry, at))
        # the phase of a wave is an angle, whatever the wave runs along
        assert not TURNING.search(unit) or not p.of_joint, (p.name, unit)
    planted = Planted(effect, at, middle(effect))
    assert not TURNING.search(planted.statement(gantry)), planted.statement(gantry)
    assert not TURNING.search(planted.separation(gantry)), planted.separation(gantry)


@pytest.mark.parametrize("effect", OF_JOINTS, ids=lambda e: e.id)
def test_a_hinge_is_told_as_the_table_says(effect: Effect, gantry: Scene) -> None:
    names = {"actuator": "mw", "sensor": "ew"}
    at = Location(effect.kind, names.get(effect.kind, "wrist"))
    assert [p.unit_in(units_at(gantry, at)) for p in effect.parameters] == [
        p.unit for p in effect.parameters
    ]


@pytest.mark.parametrize(
    ("hinge", "slide"),
    [
        ("N·m", "N"), ("N·m·s/rad", "N·s/m"), ("N·m·s²/rad²", "N·s²/m²"), ("N·m/rad", "N/m"),
        ("rad", "m"), ("rad/s", "m/s"), ("kg·m²", "kg"), ("s", "s"), ("-", "-"),
        ("1/rev", "1/(2π m)"),
    ],
)  # fmt: skip
def test_conversions(hinge: str, slide: str) -> None:
    assert SLIDE.of(hinge) == slide
    assert HINGE.of(hinge) == hinge


@pytest.mark.parametrize(
    ("kind", "name", "unit"),
    [
        ("joint", "x", "N"), ("joint", "wrist", "N·m"), ("actuator", "mz", "N"),
        ("actuator", "mw", "N·m"), ("sensor", "ex", "N"), ("sensor", "ew", "N·m"),
        ("sensor", "imu", "N·m"), ("sensor", "all", "N·m"), ("pair", "x+z", "N"),
        ("pair", "x+wrist", "N·m"), ("pair", "mx+mz", "N"), ("body", "arm", "N·m"),
        ("world", "world", "N·m"),
    ],
)  # fmt: skip
def test_places(gantry: Scene, kind: str, name: str, unit: str) -> None:
    at = Location(kind, name)  # type: ignore[arg-type]
    assert unit_at(gantry, at, "N·m") == unit


def test_distances_read_well() -> None:
    assert HINGE.distance(np.pi / 150, 2) == "1.2°"
    assert SLIDE.distance(0.0034) == "3.4 mm"
    assert SLIDE.distance(-2.5) == "-2.5 m"


def test_the_figures_are_mujocos(gantry: Scene) -> None:
    """2 N·s/m of damping hold a slide back with 1 N at .5 m/s: only the unit is another."""
    effect, at = effects()["joint.friction_viscous"], Location("joint", "x")
    spec = gantry.spec()
    effect.patch(spec, at, np.array([2.0]))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[0] = 0.5
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[0] == pytest.approx(-1.0)
    said = Planted(effect, at, np.array([2.0])).statement(gantry)
    assert said == "Joint x has 2 N·s/m of viscous friction not in the model."


@pytest.mark.parametrize(
    ("column", "unit"),
    [("qpos/x", "m"), ("qvel/x", "m/s"), ("qpos/wrist", "rad"), ("qvel/wrist", "rad/s"),
     ("ctrl/mx", "m"), ("ctrl/mz", "N"), ("ctrl/mw", "N·m"), ("ctrl/nobody", ""),
     ("sensor/imu/0", "")],
)  # fmt: skip
def test_a_recorded_column_has_the_unit_of_what_it_moves(
    tmp_path: Path, column: str, unit: str
) -> None:
    path = tmp_path / "gantry.xml"
    path.write_text(GANTRY)
    assert column_unit(Scene(path), column) == unit
