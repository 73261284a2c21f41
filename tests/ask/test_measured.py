"""What the sensors of a model measure, read off a machine that has one of each kind."""

from __future__ import annotations

from pathlib import Path

import pytest

from wt.ask.measured import Measured, measured
from wt.physics.scene import Scene

MACHINE = """<mujoco><worldbody><camera name="eye" pos="0 -1 0"/>
<body name="upper"><joint name="a" axis="0 1 0"/><geom name="rod" size=".02" fromto="0 0 0 .2 0 0"
 type="capsule"/><site name="imu"/><body name="lower" pos=".2 0 0"><joint name="b" axis="0 1 0"/>
<geom size=".02" fromto="0 0 0 .2 0 0" type="capsule"/></body></body></worldbody>
<actuator><motor name="left" joint="a"/><motor name="right" joint="a"/><motor name="wrist"
 joint="b"/></actuator><sensor>{}</sensor></mujoco>"""


def of(tmp_path: Path, sensors: str) -> Measured:
    path = tmp_path / "machine.xml"
    path.write_text(MACHINE.format(sensors))
    return measured(Scene(path))


def test_without_sensors_every_joint_has_an_encoder(tmp_path: Path) -> None:
    assert of(tmp_path, "") == Measured(False, ("a", "b"), (), (), (), ())


@pytest.mark.parametrize(
    ("sensors", "expected"),
    [
        ('<jointpos joint="b"/>', Measured(True, ("b",), (), (), (), ())),
        ('<actuatorpos actuator="wrist"/>', Measured(True, ("b",), (), (), (), ())),
        ('<jointvel joint="a"/>', Measured(True, (), ("a",), (), (), ())),
        ('<actuatorvel actuator="left"/>', Measured(True, (), ("a",), (), (), ())),
        # a joint whose position is measured tells its velocity anyway
        ('<jointvel joint="a"/><jointpos joint="a"/>', Measured(True, ("a",), (), (), (), ())),
        ('<actuatorfrc actuator="right"/>', Measured(False, ("a", "b"), (), ("right",), (), ())),
        (
            '<jointactuatorfrc joint="a"/><actuatorfrc actuator="left"/>',
            Measured(False, ("a", "b"), (), ("left", "right"), (), ()),
        ),
        (
            '<framepos objtype="geom" objname="rod"/><gyro site="imu"/>',
            Measured(False, ("a", "b"), (), (), (0, 1), ()),
        ),
        # a camera has no Jacobian here, and a clock no place
        (
            '<framepos name="view" objtype="camera" objname="eye"/><clock name="watch"/>',
            Measured(False, ("a", "b"), (), (), (), ("view", "watch")),
        ),
    ],
)
def test_each_kind_of_sensor(tmp_path: Path, sensors: str, expected: Measured) -> None:
    assert of(tmp_path, sensors) == expected
