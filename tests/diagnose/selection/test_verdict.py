"""What nothing explains is said of the places that bear most of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.diagnose import synthetic
from tests.diagnose.hidden_forces import world
from wt.diagnose.likelihood.estimate import Estimated
from wt.diagnose.likelihood.objective import Assessed
from wt.diagnose.result import Verdict
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.holdout import Gain
from wt.diagnose.selection.verdict import (
    bearing,
    findings,
    left_over,
    shown_by_holdout,
    verdict,
)
from wt.diagnose.unknown.force import Unknown
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location


def test_the_fewest_that_bear_most_are_named_the_largest_first() -> None:
    shares = {"hip": 0.25, "knee": 0.4, "abduct": 0.2, "other": 0.1, "last": 0.05}
    assert bearing(shares, 0.8) == ("knee", "hip", "abduct")


def test_one_that_bears_it_alone_is_named_alone() -> None:
    assert bearing({"hip": 0.1, "knee": 0.9}, 0.8) == ("knee",)
    assert bearing({}, 0.8) == ()


@pytest.mark.parametrize(
    ("before", "at_j2", "after", "places"),
    [
        ("no_mismatch", 2e-5, "no_mismatch", []),
        ("no_mismatch", 0.1, "unexplained", ["j2"]),
        ("explained", 2e-5, "explained", []),
        ("explained", 0.1, "partly_explained", []),
        ("partly_explained", 0.1, "partly_explained", []),
    ],
)
def test_nothing_is_missing_only_where_the_held_out_recordings_say_so_too(
    tmp_path: Path, before: Verdict, at_j2: float, after: Verdict, places: list[str]
) -> None:
    held = world(tmp_path, 2, None, 3.0).objective
    assessed = Mock(spec=Assessed, mse=np.array([2e-5, at_j2]) ** 2)
    given = dataclasses.replace(synthetic.nothing(), verdict=before)
    counted = shown_by_holdout(given, assessed, held)
    assert counted.verdict == after
    assert [f.at.name for f in counted.findings] == places
    assert [place.at.name for place in counted.locations] == places
    assert all(f.effect == "unknown" and f.p_value < 1e-9 for f in counted.findings)
    assert (before == "explained" != after) == any("held-out" in n for n in counted.notes)


@pytest.mark.parametrize(
    ("effects_at_j2", "left", "said"),
    [
        (1, 1.04, "explained"),
        (1, 2.9, "explained"),
        (1, 3.1, "partly_explained"),
        (4, 1.04, "explained"),
        (4, 1.6, "partly_explained"),
    ],
)
def test_the_more_effects_share_a_joint_the_nearer_to_the_noise_they_must_get(
    tmp_path: Path, effects_at_j2: int, left: float, said: str
) -> None:
    objective = world(tmp_path, 2, None, 3.0).objective
    rubs = Planted(effects()["joint.friction_coulomb"], Location("joint", "j2"), np.array([0.1]))
    mse = (np.array([1.0, left]) * objective.floor) ** 2
    assessed = Mock(spec=Assessed, hypothesis=(rubs,) * effects_at_j2, mse=mse)
    accepted = (Accepted(rubs, None, ()),) * effects_at_j2
    claims = Claims(accepted, Estimated(assessed, ()), (), ())
    assert verdict(claims, objective) == said


@pytest.mark.parametrize(
    ("left", "suspected", "said"),
    [
        (2.0, True, "no_mismatch"),
        (8.0, False, "no_mismatch"),
        (8.0, True, "unexplained"),
    ],
)
def test_what_is_beyond_noise_and_no_noise_is_a_mismatch_however_small(
    tmp_path: Path, left: float, suspected: bool, said: str
) -> None:
    """Below a hundredth of the motion tolerances may do it, unless a law predicts the force."""
    objective = world(tmp_path, 2, None, 3.0).objective
    mse = (np.array([1.0, left]) * objective.floor) ** 2
    assert np.sqrt(mse[1]) < 0.01 * np.nanstd(objective.measured[:, 1])
    law = Mock(spec=Unknown, statement="Joint j2 is held back.", depends_on=("qvel/j2",))
    law.planted = Mock(spec=Planted, at=Location("joint", "j2"))
    estimated = Estimated(Mock(spec=Assessed, hypothesis=(), mse=mse), ())
    claims = Claims((), estimated, (), (), suspected=(law,) if suspected else ())
    assert verdict(claims, objective) == said
    found = left_over(claims, objective)
    assert [(f.at.name, f.depends_on) for f in found] == [("j2", ("qvel/j2",))] * (
        said == "unexplained"
    )
    assert all(f.lawless and "prove no law" in f.statement for f in found)


def test_what_no_recording_tells_from_a_finding_is_listed_whatever_replays_say(
    tmp_path: Path,
) -> None:
    replays = world(tmp_path, 2, None, 3.0).objective
    late = Planted(effects()["actuator.delay"], Location("actuator", "all"), np.array([0.03]))
    assessed = Mock(spec=Assessed, hypothesis=(late,), mse=replays.floor**2)
    gain = Gain(share=0.9, p_value=1e-4)
    estimated = Estimated(assessed, ({},))
    claims = Claims((Accepted(late, None, ()),), estimated, (gain,), ())
    (finding,) = findings(claims, replays.scene)
    assert [(c.effect, c.at) for c in finding.confusable_with] == [
        ("sensor.delay", Location("sensor", "all"))
    ]
