"""What is replayed of what the force residual shows."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import numpy as np

from tests.physics.arm import scene
from wt.diagnose.residual.screen import Scored, Screen
from wt.diagnose.selection.candidates import EACH, KEPT, _strong
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location


def scored(effect: str, at: Location, gain: float) -> Scored:
    law = effects()[effect]
    return Scored(Planted(law, at, np.ones(law.n_theta)), (), gain)


def test_what_acts_on_several_joints_is_replayed_beside_what_each_has_alone(tmp_path: Path) -> None:
    """A load shows a little at each joint; something else may show more at one, and be refused."""
    best, faint = 400.0, THRESHOLDS.replay_nats + 5.0
    assert faint < THRESHOLDS.replay_share * best
    laws = ("joint.friction_viscous", "joint.friction_coulomb", "joint.armature", "joint.stiffness")
    alone = [
        scored(law, Location("joint", f"j{j}"), best - 10 * i - j)
        for i, law in enumerate(laws)
        for j in range(3)
    ]
    loads = [scored("body.com", Location("body", b), faint) for b in ("b0", "b1", "b2")]
    screen = Mock(spec=Screen, motion=Mock(scene=scene(tmp_path)))
    chosen = _strong(screen, [*alone, *loads])
    assert len(alone) > KEPT
    assert [s for s in chosen if s in loads] == loads[:EACH]
