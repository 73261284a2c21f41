"""The robots of the trials, built from primitives: pendulums and arms of two to six joints.

Each is a chain in open air: no contacts, gravity −z, one actuator a joint unless it is passive.
Robots that stand on legs are in :mod:`wt.prove.legged_rigs`.
"""

from __future__ import annotations

from typing import Literal

from wt.prove.legged_rigs import LEGGED
from wt.prove.robot import Rig as Rig
from wt.prove.robot import RigLink as RigLink

RigName = Literal[
    "pendulum", "pendulum_motor", "arm2_passive", "arm3", "arm3_motor", "arm6"
]  # fmt: skip

PENDULUM = (
    RigLink("hinge", "rod", "0 1 0", (0.0, 0.0, 1.0), (0.0, 0.0, -0.4), 1.2, 0.03,
            (-2.6, 2.6), 0.4, 1.2, 0.01, 0.05, 30.0, 2.0, 30.0),
)  # fmt: skip

PASSIVE = (
    RigLink("crank", "crank_arm", "0 1 0", (0.0, 0.0, 1.0), (0.0, 0.0, -0.3), 1.0, 0.03,
            (-2.6, 2.6), 0.3, 0.6, 0.02, 0.1, 60.0, 3.5, 40.0),
    RigLink("trailer", "bob", "0 1 0", (0.0, 0.0, -0.3), (0.0, 0.0, -0.25), 0.6, 0.025,
            (-3.1, 3.1), 0.0, 1.0, 0.001, 0.02, 0.0, 0.0, 0.0, driven=False),
)  # fmt: skip

ARM3 = (
    RigLink("waist", "turret", "0 0 1", (0.0, 0.0, 0.1), (0.0, 0.0, 0.2), 2.0, 0.06,
            (-2.8, 2.8), 0.0, 0.9, 0.08, 0.6, 180.0, 18.0, 80.0),
    RigLink("shoulder", "upper", "0 1 0", (0.0, 0.05, 0.2), (0.3, 0.0, 0.0), 1.6, 0.04,
            (-2.0, 1.6), -0.5, 0.6, 0.08, 0.6, 260.0, 24.0, 120.0),
    RigLink("elbow", "fore", "0 1 0", (0.3, 0.0, 0.0), (0.26, 0.03, 0.0), 0.9, 0.035,
            (-2.4, 2.4), 0.7, 0.8, 0.04, 0.3, 120.0, 9.0, 60.0),
)  # fmt: skip

ARM6 = (
    RigLink("base_yaw", "shoulder_block", "0 0 1", (0.0, 0.0, 0.12), (0.0, 0.06, 0.06), 1.2, 0.05,
            (-2.9, 2.9), 0.0, 0.9, 0.10, 0.8, 260.0, 26.0, 120.0),
    RigLink("shoulder_pitch", "upper_arm", "0 1 0", (0.0, 0.09, 0.06), (0.32, 0.0, 0.0), 1.5, 0.045,
            (-2.6, 1.0), -1.0, 0.6, 0.10, 0.8, 320.0, 30.0, 120.0),
    RigLink("elbow_pitch", "forearm", "0 1 0", (0.32, 0.0, 0.0), (0.24, -0.02, 0.0), 1.0, 0.04,
            (-2.6, 2.6), 1.1, 0.7, 0.06, 0.5, 220.0, 16.0, 80.0),
    RigLink("wrist_roll", "wrist_block", "1 0 0", (0.26, -0.02, 0.0), (0.06, 0.02, 0.01), 0.6,
            0.032, (-2.9, 2.9), 0.2, 1.0, 0.015, 0.12, 45.0, 2.4, 25.0),
    RigLink("wrist_pitch", "hand_block", "0 1 0", (0.08, 0.02, 0.0), (0.06, 0.0, 0.01), 0.4, 0.03,
            (-2.1, 2.1), 0.5, 0.9, 0.015, 0.12, 45.0, 2.4, 25.0),
    RigLink("flange_roll", "gripper", "1 0 0", (0.07, 0.0, 0.0), (0.07, 0.035, 0.01), 0.45, 0.028,
            (-2.9, 2.9), -0.2, 1.1, 0.006, 0.06, 18.0, 1.0, 12.0),
)  # fmt: skip

RIGS: dict[str, Rig] = {
    "pendulum": Rig("pendulum", PENDULUM, False, 0.00025, 1.2),
    "pendulum_motor": Rig("pendulum_motor", PENDULUM, True, 0.00025, 1.2),
    "arm2_passive": Rig("arm2_passive", PASSIVE, False, 0.0005, 0.9),
    "arm3": Rig("arm3", ARM3, False, 0.0005, 1.0),
    "arm3_motor": Rig("arm3_motor", ARM3, True, 0.0005, 1.0),
    "arm6": Rig("arm6", ARM6, False, 0.0005, 1.0),
    **LEGGED,
}


def nominal_xml(rig: Rig, step: float = 0.002, gain: float = 1.0, gyro: bool = False) -> str:
    """The MJCF that a diagnosis is given.

    Args:
        rig: the robot.
        step: its time step [s].
        gain: factor on servo stiffness, with the damping following by its root.
        gyro: whether the last body carries a gyro and the first joint an encoder sensor.
    """
    return rig.xml(step, gain, gyro)
