"""Commands on the axis of a chart have the unit that their drive gives them."""

from __future__ import annotations

import mujoco
import pytest

from wt.physics.units import HINGE, command_unit

MODEL = """<mujoco><worldbody><body><joint name="j2" axis="0 1 0"/><geom size=".1"/>
</body></worldbody><actuator>{drive}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("drive", "unit"),
    [
        ('<position name="m" joint="j2" kp="40"/>', "rad"),
        ('<position name="m" joint="j2" kp="40" gear="2"/>', "0.5 rad"),
        ('<velocity name="m" joint="j2" kv="3"/>', "rad/s"),
        ('<intvelocity name="m" joint="j2" kp="40"/>', "rad/s"),
        ('<motor name="m" joint="j2"/>', "N·m"),
        ('<motor name="m" joint="j2" gear="6.33"/>', "6.33 N·m"),
        ('<general name="m" joint="j2" gainprm="4.2"/>', "4.2 N·m"),
        (
            '<general name="m" joint="j2" gainprm="20" biastype="affine" biasprm="0 -40 -1"/>',
            "0.5 rad",
        ),
        ('<general name="m" joint="j2" gaintype="affine" gainprm="1 2 3"/>', "-"),
    ],
)
def test_a_command_has_the_unit_that_its_drive_gives_it(drive: str, unit: str) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(drive=drive))
    assert command_unit(model, "m", HINGE) == unit
