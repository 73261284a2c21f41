"""A one-joint arm under a load of one sign, and laws that look alike on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.ask.alive import Alive
from wt.ask.limits import Limits
from wt.diagnose.experiment.reach import Reach, Shown, reach_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

XML = """<mujoco><compiler angle="radian"/><option timestep=".001" integrator="implicitfast"/>
<worldbody><body name="link"><joint name="j" axis="0 1 0" damping=".3" range="-2 2"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass=".8"/></body></worldbody>
<actuator><position name="a" joint="j" kp="40" kv="2"/></actuator></mujoco>"""
AT, JOINT = Location("actuator", "a"), Location("joint", "j")
RATE = 100.0


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    path = tmp_path / "arm.xml"
    path.write_text(XML)
    return Scene(path)


def law(
    name: str, at: Location, *theta: float, spread: float = 0.05, differs: bool = True
) -> Alive:
    """A hypothesis of one effect, its parameters known to a share."""
    planted = Planted(effects()[name], at, np.array(theta))
    return Alive((planted,), spread * np.abs(theta), planted if differs else None)


def bias_or_dead_band() -> list[Alive]:
    """The same where the drive only ever lifts: gravity's load is 1.2 N·m."""
    return [law("actuator.bias", AT, 0.4, differs=False), law("actuator.deadband", AT, 0.4)]


def reach(arm: Scene) -> Reach:
    """Of a machine that has shown half a radian around level, and 2 rad/s."""
    q = np.linspace(-0.5, 0.5, 100)[:, None]
    v = np.full_like(q, 2.0)
    v[-1] = 0.0
    q[-1] = 0.0
    return reach_of(arm, [Shown("all", False, q, v, q)])


def limits(arm: Scene) -> Limits:
    """None at all."""
    ends = np.array([[-np.inf], [np.inf]])
    return Limits(arm, ends, ends[1], None)
