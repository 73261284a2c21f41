"""What held-out data refuse is given up, at the price of fits."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, world
from wt.diagnose.selection import naming
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.naming import Naming
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location


def test_of_several_that_are_refused_only_the_last_takes_an_estimate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing, log = world(tmp_path, 2, None, 2.5), DecisionLog()
    found = tuple(
        Accepted(Planted(effects()[name], Location("joint", joint), np.array([size])), None, ())
        for name, joint, size in (
            ("joint.friction_viscous", "j1", 0.01),
            ("joint.friction_viscous", "j2", 0.01),
            ("joint.armature", "j2", 0.001),
        )
    )
    estimates, fits = Mock(wraps=naming.estimate), Mock(wraps=naming.fitted)
    monkeypatch.setattr(naming, "estimate", estimates)
    monkeypatch.setattr(naming, "fitted", fits)
    # intervals that hold nothing at all would drop each before it is asked
    monkeypatch.setattr(naming, "distances_from_nothing", lambda _: {})
    replays = nothing.objective
    proofs = Naming(nothing.screen, replays, replays, lambda: replays, nothing.held, STEP, 0, log)
    claims = proofs.proven(found, known={a.planted.key for a in found})
    assert claims.accepted == claims.gains == ()
    assert (estimates.call_count, fits.call_count) == (2, 2)
    refused = [d for d in log if d.stage == "holdout"]
    assert len(refused) == 3 and not any(d.kept for d in refused)
