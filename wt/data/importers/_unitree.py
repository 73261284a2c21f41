"""Unitree's LowState and LowCmd in bags: motors as joints, the IMU as an Imu.

Messages, and the definitions for bags that keep none (before ROS 2 Iron), are those of
github.com/unitreerobotics/unitree_ros2 (``unitree_go``: Go2, B2, H1; ``unitree_hg``: G1, H1-2). The
order of the motors is that of Unitree's SDK: of the quadrupeds FR, FL, RR, RL with hip, thigh and
calf, of the G1 with 29 motors that of its ``G1JointIndex``. Slots that are zero throughout are
empty. A motor whose robot cannot be told is ``motor<number>``.

Of a LowCmd ``q`` is the command, and ``tau`` where no gain ``kp`` is ever above zero; the map's
``command_field`` chooses otherwise. What the SDK sends for "no position" (2.146e9) is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

_LEGS = tuple(f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL")
              for part in ("hip", "thigh", "calf"))  # fmt: skip
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch",
        "wrist_yaw")  # fmt: skip
_G1 = (
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _LEG),
    *(f"waist_{axis}_joint" for axis in ("yaw", "roll", "pitch")),
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _ARM),
)
_NO_POSITION, _NO_SPEED = 1e6, 1.5e4
_TYPES = ("LowState", "LowCmd")
DEFINITIONS = {
    "unitree_go/msg/LowState": (
        "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n"
        "uint16 bandwidth\nIMUState imu_state\nMotorState[20] motor_state\nBmsState bms_state\n"
        "int16[4] foot_force\nint16[4] foot_force_est\nuint32 tick\nuint8[40] wireless_remote\n"
        "uint8 bit_flag\nfloat32 adc_reel\nint8 temperature_ntc1\nint8 temperature_ntc2\n"
        "float32 power_v\nfloat32 power_a\nuint16[4] fan_frequency\nuint32 reserve\nuint32 crc"
    ),
    "unitree_go/msg/LowCmd": (
        "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n"
        "uint16 bandwidth\nMotorCmd[20] motor_cmd\nBmsCmd bms_cmd\nuint8[40] wireless_remote\n"
        "uint8[12] led\nuint8[2] fan\nuint8 gpio\nuint32 reserve\nuint32 crc"
    ),
    "unitree_go/msg/MotorState": (
        "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\n"
        "float32 dq_raw\nfloat32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve"
    ),
    "unitree_go/msg/MotorCmd": (
        "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32[3] reserve"
    ),
    "unitree_go/msg/IMUState": (
        "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
        "int8 temperature"
    ),
    "unitree_go/msg/BmsState": (
        "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\n"
        "uint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol"
    ),
    "unitree_go/msg/BmsCmd": "uint8 off\nuint8[3] reserve",
    "unitree_hg/msg/LowState": (
        "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nIMUState imu_state\n"
        "MotorState[35] motor_state\nuint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc"
    ),
    "unitree_hg/msg/LowCmd": (
        "uint8 mode_pr\nuint8 mode_machine\nMotorCmd[35] motor_cmd\nuint32[4] reserve\nuint32 crc"
    ),
    "unitree_hg/msg/MotorState": (
        "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nint16[2] temperature\n"
        "float32 vol\nuint32[2] sensor\nuint32 motorstate\nuint32[4] reserve"
    ),
    "unitree_hg/msg/MotorCmd": (
        "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32 reserve"
    ),
    "unitree_hg/msg/IMUState": (
        "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
        "int16 temperature"
    ),
}
"""Type → its fields."""


def is_low_level(type_: str) -> bool:
    """True for a LowState or LowCmd."""
    package, _, name = type_.rpartition("/")
    return package.startswith("unitree") and name in _TYPES


def motors(message: Any) -> SimpleNamespace:  # noqa: ANN401
    """A message's motors in the form of a JointState, with their gains as ``kp``.

    Args:
        message: a LowState or LowCmd.
    """
    state = hasattr(message, "motor_state")
    listed = message.motor_state if state else message.motor_cmd
    return SimpleNamespace(
        name=[f"motor{i}" for i in range(len(listed))],
        position=[_or_nan(float(m.q), _NO_POSITION) for m in listed],
        velocity=[_or_nan(float(m.dq), _NO_SPEED) for m in listed],
        effort=[float(m.tau_est if state else m.tau) for m in listed],
        kp=[] if state else [float(m.kp) for m in listed],
    )


def imu(message: Any) -> SimpleNamespace:  # noqa: ANN401
    """A LowState's IMU in the form of an Imu; Unitree's quaternion is w, x, y, z.

    Args:
        message: a LowState.
    """
    w, x, y, z = (float(v) for v in message.imu_state.quaternion)
    return SimpleNamespace(
        orientation=SimpleNamespace(w=w, x=x, y=y, z=z),
        orientation_covariance=[0.0] if any((w, x, y, z)) else [-1.0],
        angular_velocity=_vector(message.imu_state.gyroscope),
        linear_acceleration=_vector(message.imu_state.accelerometer),
    )


def joint_names(used: Sequence[int]) -> dict[int, str]:
    """Slot of a motor → its joint: a quadruped's if 12 are used, the G1's if 29 are.

    Args:
        used: slots that are not empty.
    """
    for known in (_LEGS, _G1):
        if sorted(used) == list(range(len(known))):
            return dict(enumerate(known))
    return {i: f"motor{i}" for i in used}


def name_motors(
    states: Sequence[SimpleNamespace], commands: Sequence[SimpleNamespace], package: str
) -> str:
    """Give motors their joints' names, in place, and take empty slots and idle commands out.

    Args:
        states: all messages of the robot's state, as :func:`motors` gives them.
        commands: all that was sent to it.
        package: ``unitree_go`` or ``unitree_hg``.

    Returns:
        What was assumed.
    """
    sample = states or commands
    width = len(sample[0].name)
    used = [
        i for i in range(width)
        if any(m.position[i] or m.velocity[i] or m.effort[i] for m in sample)
    ]  # fmt: skip
    names = joint_names(used)
    fits = bool(used) and names[used[0]] in (_LEGS if package == "unitree_go" else _G1)
    by_torque = not any(any(gain > 0.0 for gain in m.kp) for m in commands)
    for message in (*states, *commands):
        keep = [i for i in used if i < len(message.name)]
        message.name = [names[i] for i in keep]
        for field in ("position", "velocity", "effort"):
            values = getattr(message, field)
            setattr(message, field, [values[i] for i in keep])
    for message in commands:
        if by_torque:
            message.position = message.velocity = []
    if fits:
        robot = "a quadruped" if package == "unitree_go" else "the G1 with 29 joints"
        return f"motors are taken for those of {robot}, in the order of Unitree's SDK"
    return f"motors have no names: {len(used)} are used; name them in the map with 'joints'"


def _or_nan(value: float, most: float) -> float:
    return value if abs(value) < most else float("nan")


def _vector(values: Any) -> SimpleNamespace:  # noqa: ANN401
    x, y, z = (float(v) for v in values)
    return SimpleNamespace(x=x, y=y, z=z)
