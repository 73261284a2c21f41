"""Which of several weak effects leave at once."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest

from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.selection.leaving import weakest_of_each
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

AT = {"hip": 0, "knee": 1, "all": -1}


def planted(name: str, kind: str, place: str) -> Planted:
    return Planted(effects()[name], Location(kind, place), np.ones(1))


HYPOTHESIS = (
    planted("joint.friction_coulomb", "joint", "hip"),
    planted("joint.friction_viscous", "joint", "hip"),
    planted("joint.friction_coulomb", "joint", "knee"),
    planted("sensor.delay", "sensor", "all"),
)


@pytest.mark.parametrize(
    ("forgets", "weak", "leaving"),
    [
        (True, [1, 0, 2], [1, 2]),  # two at the hip: the second is asked anew
        (True, [2, 3, 1], [2, 1]),  # what acts on all is asked anew
        (True, [3, 0], [3, 0]),
        (False, [1, 0, 2], [1]),  # limbs that swing pull at each other
        (True, [], []),
        (False, [], []),
    ],
)
def test_one_of_each_joint_leaves_where_drives_hold_a_machine(
    forgets: bool, weak: list[int], leaving: list[int]
) -> None:
    objective = Mock(spec=Objective, forgets=forgets, scene=Mock(dof_at=lambda at: AT[at.name]))
    assert weakest_of_each(objective, HYPOTHESIS, weak) == leaving
