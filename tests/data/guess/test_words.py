"""What names of quantities say, as robots' logs have them."""

from __future__ import annotations

import pytest

from wt.data.guess.words import meaning


@pytest.mark.parametrize(
    ("name", "kind", "stem"),
    [
        ("shoulder_pan.pos", "qpos", "shoulder_pan"),
        ("actual_qd_3", "qvel", "3"),
        ("target_q_3", "ctrl", "3"),
        ("/lowstate/motor_state[7]/dq", "qvel", "7"),
        ("motor_state[7].tau_est", "force", "7"),
        ("leftKneeTorqueCmd", "ctrl", "left_knee"),
        ("Present Current Elbow (mA)", "other", ""),
        ("current_position_elbow", "qpos", "elbow"),
        ("kp_cmd_elbow", "other", ""),
        ("θ1", "qpos", "1"),
        ("imu_gyro_x", "gyro", "x"),
        ("v2", "qvel", "2"),
        ("battery", None, "battery"),
        ("time_ms", "time", ""),
    ],
)
def test_kind_and_joint(name: str, kind: str | None, stem: str) -> None:
    said = meaning(name)
    assert (said.kind, said.stem) == (kind, stem)


def test_units() -> None:
    assert meaning("elbow angle [deg]").unit == "deg"
    assert meaning("elbow_rpm_speed").unit == "rpm"
    assert meaning("t_us").seconds == 1e-6
    assert meaning("knee_vel_cmd").of == "qvel"
