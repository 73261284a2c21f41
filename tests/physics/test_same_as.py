"""What no recording can tell apart is said of both, and only of what is the same everywhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.physics.arm import ARM, scene
from wt.physics.effect import effects
from wt.physics.scene import Scene
from wt.types import Location

LATE = ("actuator.delay", Location("actuator", "all")), ("sensor.delay", Location("sensor", "all"))
ONE = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1"/></body></worldbody>
<actuator><motor name="drive" joint="hinge"/></actuator></mujoco>"""
FREE = """<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint name="root"/>
<geom size=".1"/><body name="leg"><joint name="hip" axis="0 1 0"/><geom size=".05"/></body>
</body></worldbody><actuator><motor name="drive" joint="hip"/></actuator></mujoco>"""


def pairs(of: Scene) -> set[tuple[tuple[str, Location], tuple[str, Location]]]:
    """(effect and place, what no recording tells from it) of a machine."""
    return {
        ((effect.id, at), other)
        for effect in effects().values()
        for at in effect.places(of)
        for other in effect.same_as(of, at)
    }


def test_late_commands_and_late_measurements_of_all_are_one(tmp_path: Path) -> None:
    assert pairs(scene(tmp_path, ARM)) == {LATE, LATE[::-1]}


@pytest.mark.parametrize("xml", [ARM, ONE, FREE], ids=["arm", "one joint", "floating"])
def test_each_of_two_says_so_of_a_place_where_the_other_can_be(tmp_path: Path, xml: str) -> None:
    of = scene(tmp_path, xml)
    said = pairs(of)
    assert said == {(other, one) for one, other in said}
    assert all(at in effects()[effect].places(of) for _, (effect, at) in said)


def test_what_tracks_a_base_tells_late_encoders_from_late_drives(tmp_path: Path) -> None:
    assert not pairs(scene(tmp_path, FREE))


def test_one_joint_has_them_at_itself_and_its_drive(tmp_path: Path) -> None:
    late = ("actuator.delay", Location("actuator", "drive"))
    assert (late, ("sensor.delay", Location("joint", "hinge"))) in pairs(scene(tmp_path, ONE))
