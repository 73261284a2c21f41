"""Always says dry friction, at the joint that the model explains worst."""

from __future__ import annotations

import numpy as np

from wt.prove.rivals.base import Claim, RivalTask
from wt.types import Location

_STANDS = 0.02
"""Speed below which the direction of friction is not known [rad/s]."""


def claims(task: RivalTask) -> list[Claim]:
    """One claim: the residual's part along the direction of motion, by least squares."""
    motion = task.motion
    size = np.sqrt((motion.residual**2).mean(axis=0))
    usual = np.sqrt((motion.demand**2).mean(axis=0)) + 1e-9
    joint = int(np.argmax(size / usual))
    moves = np.abs(motion.v[:, joint]) > _STANDS
    sign, force = np.sign(motion.v[moves, joint]), -motion.residual[moves, joint]
    level = float(np.mean(sign * force)) if moves.any() else 0.0
    spread = float(np.std(sign * force)) / max(np.sqrt(moves.sum()), 1.0)
    at = Location("joint", task.scene.joints[joint])
    theta, sigma = np.array([max(level, 0.0)]), np.array([spread])
    return [Claim("joint.friction_coulomb", at, theta, sigma)]
