"""What the hidden robot is commanded at each sample, given the path that it is to follow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.prove.hidden import Controller, Plant
from wt.prove.rigs import Rig

OUTER_KP = 0.4
"""Stiffness of the controller outside the model, as a share of the servo's."""


def positions(path: Float[np.ndarray, "sample joint"]) -> Controller:
    """The path itself [rad], for servos inside the model."""
    return lambda row, q, v: path[row]


def torques(
    rig: Rig, path: Float[np.ndarray, "sample joint"], t: Float[np.ndarray, " sample"]
) -> Controller:
    """A PD controller with gravity compensation outside the model: its torque is the command.

    Args:
        rig: the robot.
        path: positions to follow [rad].
        t: their times [s].
    """
    nominal = Plant(rig, [], 1.0, np.ones((2, len(rig.links))))
    # softer than the servos, since it acts at the sampling rate
    kp, kv = OUTER_KP * nominal.kp, 0.5 * nominal.kv
    hold = nominal.gravity_torques(path)
    speed = np.clip(np.gradient(path, t, axis=0), -3, 3)
    limit = nominal.limit

    def control(
        row: int, q: Float[np.ndarray, " joint"], v: Float[np.ndarray, " joint"]
    ) -> Float[np.ndarray, " joint"]:
        tau = kp * (path[row] - q) + kv * (speed[row] - v) + hold[row]
        return tau.clip(-limit, limit)

    return control
