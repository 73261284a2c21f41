"""Unitree's low-level messages of the Go2.

Names and order of the fields, and the type names that DDS matches by, are those of the maker's SDK
(``unitree_go`` in unitree_sdk2 and unitree_sdk2_python), so a real Go2 understands them.
"""

# mypy: disable-error-code="type-arg, valid-type, misc"
# cyclonedds reads annotations as objects: no "from __future__ import annotations" here.

import cyclonedds.idl.annotations as annotate
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, int16, int32, uint8, uint16, uint32

from deploy.messages import Packed

MOTORS = 20
"""Motors that a message has room for; the Go2's twelve come first."""


@annotate.final
@annotate.autoid("sequential")
class BmsCmd_(IdlStruct, typename="unitree_go.msg.dds_.BmsCmd_"):
    """To the battery's electronics."""

    off: uint8
    reserve: array[uint8, 3]


@annotate.final
@annotate.autoid("sequential")
class MotorCmd_(IdlStruct, typename="unitree_go.msg.dds_.MotorCmd_"):
    """To one drive: torque = kp·(q − measured) + kd·(dq − measured) + tau [rad, rad/s, N·m]."""

    mode: uint8
    q: float32
    dq: float32
    tau: float32
    kp: float32
    kd: float32
    reserve: array[uint32, 3]


@annotate.final
@annotate.autoid("sequential")
class LowCmd_(IdlStruct, Packed, typename="unitree_go.msg.dds_.LowCmd_"):
    """To all drives, on the topic ``rt/lowcmd``."""

    head: array[uint8, 2]
    level_flag: uint8
    frame_reserve: uint8
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    motor_cmd: array[MotorCmd_, MOTORS]
    bms_cmd: BmsCmd_
    wireless_remote: array[uint8, 40]
    led: array[uint8, 12]
    fan: array[uint8, 2]
    gpio: uint8
    reserve: uint32
    crc: uint32


@annotate.final
@annotate.autoid("sequential")
class IMUState_(IdlStruct, typename="unitree_go.msg.dds_.IMUState_"):
    """Quaternion wxyz, then rad/s, m/s², rad, all in the trunk's frame, and °C."""

    quaternion: array[float32, 4]
    gyroscope: array[float32, 3]
    accelerometer: array[float32, 3]
    rpy: array[float32, 3]
    temperature: uint8


@annotate.final
@annotate.autoid("sequential")
class MotorState_(IdlStruct, typename="unitree_go.msg.dds_.MotorState_"):
    """Of one drive [rad, rad/s, rad/s², N·m, °C]."""

    mode: uint8
    q: float32
    dq: float32
    ddq: float32
    tau_est: float32
    q_raw: float32
    dq_raw: float32
    ddq_raw: float32
    temperature: uint8
    lost: uint32
    reserve: array[uint32, 2]


@annotate.final
@annotate.autoid("sequential")
class BmsState_(IdlStruct, typename="unitree_go.msg.dds_.BmsState_"):
    """Of the battery; ``soc`` is the charge that is left [%]."""

    version_high: uint8
    version_low: uint8
    status: uint8
    soc: uint8
    current: int32
    cycle: uint16
    bq_ntc: array[uint8, 2]
    mcu_ntc: array[uint8, 2]
    cell_vol: array[uint16, 15]


@annotate.final
@annotate.autoid("sequential")
class LowState_(IdlStruct, Packed, typename="unitree_go.msg.dds_.LowState_"):
    """Of the whole robot, on the topic ``rt/lowstate``; ``tick`` counts milliseconds."""

    head: array[uint8, 2]
    level_flag: uint8
    frame_reserve: uint8
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    imu_state: IMUState_
    motor_state: array[MotorState_, MOTORS]
    bms_state: BmsState_
    foot_force: array[int16, 4]
    foot_force_est: array[int16, 4]
    tick: uint32
    wireless_remote: array[uint8, 40]
    bit_flag: uint8
    adc_reel: float32
    temperature_ntc1: uint8
    temperature_ntc2: uint8
    power_v: float32
    power_a: float32
    fan_frequency: array[uint16, 4]
    reserve: uint32
    crc: uint32
