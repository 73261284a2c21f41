"""Names, numbers and limits of the Go2's motors, against its MJCF."""

from __future__ import annotations

import numpy as np
import pytest

from deploy import go2
from deploy.idl import LowState_
from deploy.remote import Remote
from wt.errors import ModelError
from wt.worlds import go2_model


def test_motors_are_numbered_leg_by_leg_from_the_front_right() -> None:
    """By the maker: FR 0–2, FL 3–5, RR 6–8, RL 9–11, each hip, thigh, calf."""
    expected = {"FR": 0, "FL": 3, "RR": 6, "RL": 9}
    for joint, motor in zip(go2_model.JOINTS, go2.motors(go2_model.JOINTS), strict=True):
        leg, part, _ = joint.split("_")
        assert motor == expected[leg] + ("hip", "thigh", "calf").index(part)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (go2_model.JOINTS[:11], "RR_calf_joint"),
        ((*go2_model.JOINTS[:11], "wheel"), "RR_calf_joint, wheel"),
        ((*go2_model.JOINTS[:11], go2_model.JOINTS[0]), "RR_calf_joint"),
        ((*go2_model.JOINTS, go2_model.JOINTS[0]), "one twice"),
    ],
)
def test_other_joints_are_refused(joints: tuple[str, ...], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        go2.motors(joints)


def test_limits_are_those_of_the_mjcf() -> None:
    model = go2_model.build(go2_model.PUBLISHED, 0.005)
    shuffled = np.random.default_rng(0).permutation(go2_model.JOINTS).tolist()
    drives = go2.drives(shuffled)
    for k, joint in enumerate(shuffled):
        np.testing.assert_allclose((drives.low[k], drives.high[k]), model.joint(joint).range)
        assert drives.torque[k] == model.actuator(joint).forcerange[1]
        assert drives.speed[k] > 0


def test_a_state_is_in_the_order_of_the_policy() -> None:
    message = LowState_()
    fields = message.data
    fields["motor_state"]["q"][:12] = np.arange(12)
    fields["motor_state"]["dq"][:12] = 10 * np.arange(12)
    fields["motor_state"]["tau_est"][:12] = 100 * np.arange(12)
    fields["motor_state"]["temperature"][3] = 256 - 7  # −7 °C
    fields["motor_state"]["q"][12:] = np.nan  # the unused ones say nothing
    fields["imu_state"]["quaternion"] = 0.5, 0.5, -0.5, 0.5
    fields["imu_state"]["gyroscope"] = 1, 2, 3
    fields["bms_state"]["soc"], fields["tick"] = 77, 123456
    fields["wireless_remote"] = list(Remote(frozenset({"start"})).pack())
    joints = ("FL_hip_joint", "RR_calf_joint", "FR_thigh_joint")
    motor = np.array([go2.JOINTS.index(joint) for joint in joints])
    state = go2.unpack(message, motor)
    assert state.position.tolist() == [3, 8, 1]
    assert state.velocity.tolist() == [30, 80, 10] and state.torque.tolist() == [300, 800, 100]
    assert state.temperature.tolist() == [-7, 0, 0]
    assert state.quaternion.tolist() == [0.5, 0.5, -0.5, 0.5] and state.gyro.tolist() == [1, 2, 3]
    assert (state.battery, state.time) == (77, 123.456)
    assert state.remote.buttons == {"start"}
