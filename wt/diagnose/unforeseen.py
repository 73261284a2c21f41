"""Where nothing was found and still replays err by much: that is said, without a law."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import chi2

from wt.diagnose.assessed import Assessed
from wt.diagnose.objective import Objective
from wt.diagnose.result import Finding
from wt.diagnose.worth import CLEAN
from wt.types import Location

MISMATCH = 0.01
"""Share of a joint's motion that replays must err by before it is called unexplained."""
MOST = 0.8
"""Share of the error that the places named bear where one fault shows on all joints."""


def erring(assessed: Assessed, objective: Objective) -> dict[str, float]:
    """Joints whose replays err by much, with their shares of it."""
    # a very quiet sensor sees what any rig is off by: that alone is no mismatch
    left, moved = np.sqrt(assessed.mse), np.nanstd(objective.measured, axis=0)
    large = (left > CLEAN * objective.floor) & (left > MISMATCH * moved)
    size = np.where(large, (left / objective.noise) ** 2, 0.0)
    names = objective.scene.joints
    return {names[j]: float(size[j] / size.sum()) for j in np.flatnonzero(large)}


def unforeseen(
    assessed: Assessed, objective: Objective, where: Mapping[str, float]
) -> tuple[Finding, ...]:
    """At joints that err: something unknown, without a law.

    Args:
        assessed: what was found.
        objective: replays of all fitted data.
        where: joint → share of the error. What one foot meets shows on all joints of a machine
            that nothing holds: there, the fewest are named that bear most of it.
    """
    found: dict[Location, Finding] = {}
    for joint in bearing(where, MOST) if objective.scene.free else where:
        dof, at = objective.scene.dof(joint), objective.scene.place(joint)
        excess = float(assessed.mse[dof] / objective.noise[dof] ** 2)
        count = float(objective.count[dof])
        found.setdefault(
            at,
            Finding(
                effect="unknown",
                at=at,
                parameters={},
                statement=(
                    f"{at.kind.capitalize()} {at.name} is moved by something unknown that "
                    "nothing recorded predicts."
                ),
                holdout_gain=0.0,
                # of noise alone being as large
                p_value=float(chi2.sf(excess * count, count)),
            ),
        )
    return tuple(found.values())


def bearing(shares: Mapping[str, float], most: float) -> tuple[str, ...]:
    """The fewest names whose shares come to ``most`` of all, the largest first."""
    names = sorted(shares, key=lambda name: -shares[name])
    before = np.cumsum([0.0, *(shares[name] for name in names)])
    return tuple(name for name, sum_ in zip(names, before, strict=False) if sum_ < most)
