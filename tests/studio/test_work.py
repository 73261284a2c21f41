"""What is told of a diagnosis while it runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.studio import work
from wt.types import Location

DRY = Planted(effects()["joint.friction_coulomb"], Location("joint", "a"), np.array([0.1]))
WET = Planted(effects()["joint.friction_viscous"], Location("joint", "a"), np.array([0.1]))


def test_the_best_so_far_is_what_has_joined_and_not_left() -> None:
    told: dict[str, Any] = {}
    log = work._Watched(told.update)
    log.trying([DRY, WET, WET], DRY)
    assert told["trying"] == [
        "joint.friction_coulomb at joint a",
        "joint.friction_viscous at joint a",
    ]
    assert told["leading"] == "joint.friction_coulomb at joint a"
    log.add(WET, "screened", False, 1.0, 2.0, "not replayed")
    assert "tried" not in told
    log.add(DRY, "joined", True, 9.0, 2.0, "the best addition")
    log.add(WET, "replayed", False, 1.0, 2.0, "beaten")
    assert (told["tried"], told["best"]) == (2, ["joint.friction_coulomb at joint a"])
    assert told["said"] == "joint.friction_viscous at joint a: beaten"
    log.add(DRY, "pruned", False, 1.0, 2.0, "the others say as much")
    assert told["best"] == [] and told["leading"] == ""
    assert len(list(log)) == 4
