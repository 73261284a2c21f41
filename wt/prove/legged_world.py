"""Parts of a legged robot's world that an arm's lacks: a floor, a trunk, and a balance."""

from __future__ import annotations

import numpy as np

from wt.prove.body_laws import HiddenMass
from wt.prove.case import Case
from wt.prove.contact_laws import HiddenFloorTolerance
from wt.prove.hidden import HiddenLaw, Parameters
from wt.prove.legged_rigs import FLOOR, Legged
from wt.prove.trajectory import HiddenTrajectory

CALM = (1.0, 0.7, 0.45, 0.2)
"""Sizes of a motion that are tried until the robot stays on its feet."""
_TILT = 0.7  # rad, at which it counts as fallen
_LOW = 0.6  # of its height when standing


def tolerances(case: Case, rig: Legged) -> list[HiddenLaw]:
    """Model tolerances of trunk and floor: a few per cent in every world."""
    rng = np.random.default_rng([case.seed, 6])
    trunk: Parameters = {"factor": 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.03)}
    floor: Parameters = {
        "friction": 1.0 + rng.uniform(-0.03, 0.03),
        "time_constant": 1.0 + rng.uniform(-0.1, 0.1),
    }
    return [HiddenMass(rig.trunk, trunk, rng), HiddenFloorTolerance(FLOOR, floor, rng)]


def upright(trace: HiddenTrajectory, rig: Legged) -> bool:
    """True if the robot stayed on its feet throughout."""
    _, x, y, _ = trace.base_q[:, 3:].T
    # the trunk's own z axis over the world's: 1 − 2(x² + y²)
    tilt = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))
    return bool(tilt.max() < _TILT and trace.base_q[:, 2].min() > _LOW * rig.height - 0.1)
