"""Where a machine stands, by what it has shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.diagnose.experiment.reach import Shown, reach_of
from wt.physics.scene import Scene

XML = """<mujoco><compiler angle="radian"/><worldbody><body>
<joint name="j" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body></worldbody><actuator><position name="a" joint="j" kp="40" kv="2"/></actuator></mujoco>"""


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    path = tmp_path / "arm.xml"
    path.write_text(XML)
    return Scene(path)


def shown(name: str, held_out: bool, q: list[float], v: list[float]) -> Shown:
    positions = np.array(q)[:, None]
    return Shown(name, held_out, positions, np.array(v)[:, None], positions)


def test_a_recording_that_ends_in_motion_began_where_the_machine_stands(arm: Scene) -> None:
    parts = [
        shown("one", False, [0.3, 0.4, 0.6], [0.0, 1.0, 1.0]),
        shown("one", True, [0.7, 0.8, 0.9], [0.5, 1.0, 1.0]),
    ]
    for order in (parts, parts[::-1]):  # whichever part is told first
        assert reach_of(arm, order).rest == pytest.approx([0.3])


def test_a_recording_that_ends_at_rest_says_where(arm: Scene) -> None:
    other = shown("one", False, [0.1, 0.2, 0.1], [0.0, 1.0, 0.0])
    last = shown("two", True, [0.4, 0.5, 0.7], [0.0, 1.0, 0.0])
    assert reach_of(arm, [other, last]).rest == pytest.approx([0.7])


def test_one_that_never_rests_stood_where_it_was_slowest(arm: Scene) -> None:
    moving = shown("one", False, [0.1, 0.2, 0.3], [0.8, 0.2, 1.0])
    assert reach_of(arm, [moving]).rest == pytest.approx([0.2])


def test_before_anything_is_recorded_it_stands_in_the_first_keyframe(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    key = '<keyframe><key name="home" qpos="-1.2"/></keyframe></mujoco>'
    path.write_text(XML.replace("</mujoco>", key))
    assert reach_of(Scene(path), []).rest == pytest.approx([-1.2], abs=0.05)
