"""Real machines become cases of which nobody knows the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.errors import DataError
from wt.prove import bench, real, replay
from wt.prove.case_result import CaseResult
from wt.prove.folder import Folder, Plan
from wt.prove.machines.base import machines
from wt.prove.real import present, write_case
from wt.prove.results import summary


def test_no_motion_is_both_fitted_and_held_out() -> None:
    for machine in machines().values():
        assert not set(machine.fit) & set(machine.holdout)


def test_a_folder_without_them_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"holds recordings of none of .*so101"):
        present(tmp_path)
    (tmp_path / "bam_xl330").mkdir()
    assert [machine.name for machine in present(tmp_path)] == ["servo_bench"]
    with pytest.raises(DataError, match=r"no motion .*kp200_sin_sin.json'"):
        write_case(present(tmp_path)[0], tmp_path, tmp_path / "case")


def test_the_servo_bench_as_a_case(
    shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "recordings"
    home.mkdir()
    (home / "bam_xl330").symlink_to(shared / "recordings" / "bam_xl330")
    monkeypatch.setattr(bench, "cases", lambda set, seed: [])
    monkeypatch.setattr(bench, "chosen", lambda set, only, seed: [])
    plan = Plan("full", "", 0, ("coulomb",), "", "this code", str(home))
    trial = Folder.begin(tmp_path / "trial", plan)
    bench.make(trial, 1, lambda what, share: None)
    (name,) = trial.manifest
    assert sorted(path.name for path in (trial.cases / name).glob("*.parquet")) == [
        "fit-1.parquet", "fit-2.parquet", "holdout-1.parquet",
    ]  # fmt: skip
    measured = replay.read(
        trial.cases / name / "robot.xml", [trial.cases / name / "holdout-1.parquet"]
    )
    # published open-loop errors of models with fitted friction are .05 to .09 rad
    assert 0.05 < replay.rmse(trial.cases / name / "robot.xml", measured) < 0.5


def test_the_repeat_floor_of_the_arm(shared: Path, tmp_path: Path) -> None:
    """Published for this arm (median of 61 pairs, runs apart): pan .004, lift .005, elbow .014."""
    arm = machines()["so101"]
    floor = real._floor(arm, shared / "recordings")
    apart = {joint: np.sqrt(2.0) * deviation for joint, deviation in floor.items()}
    assert apart["shoulder_pan"] == pytest.approx(0.004, rel=0.5)
    assert apart["shoulder_lift"] == pytest.approx(0.005, rel=0.6)
    assert apart["elbow_flex"] == pytest.approx(0.014, rel=0.5)


@pytest.mark.parametrize("name", machines())
def test_models_and_recordings_go_together(name: str) -> None:
    """Joints of what was published are those that are given, and both compile."""
    machine = machines()[name]
    given, published = machine.given().compile(), machine.published()
    if published is not None:
        fitted = published.compile()
        assert [given.joint(i).name for i in range(given.njnt)] == [
            fitted.joint(i).name for i in range(fitted.njnt)
        ]
        lossy = fitted.dof_frictionloss.sum() + fitted.dof_damping.sum()
        assert lossy > given.dof_frictionloss.sum() + given.dof_damping.sum()


@pytest.mark.parametrize(
    ("name", "published", "given"),
    [
        ("stage", (0.5e-3, 1.2e-3), (15e-3, 30e-3)),
        ("free_pendulum", (1e-4, 0.01), (1e-3, 0.05)),
    ],
)
def test_errors_are_those_that_were_published(
    name: str,
    published: tuple[float, float],
    given: tuple[float, float],
    shared: Path,
    tmp_path: Path,
) -> None:
    """Half-second replays from the measured state, as each laboratory or its readers report."""
    answer = write_case(machines()[name], shared / "recordings", tmp_path / "case")
    measured = replay.read(
        tmp_path / "case" / "robot.xml", sorted((tmp_path / "case").glob("holdout-*.parquet"))
    )
    before = replay.rmse(tmp_path / "case" / "robot.xml", measured)
    assert given[0] < before < given[1]
    assert published[0] < answer.published_rmse < published[1]
    assert answer.published_rmse < before


def test_they_count_in_no_score() -> None:
    data = {
        "id": "case-1", "name": "real-arm", "kind": "real", "rig": "arm", "decoy": "", "level": "",
        "truth": [],
        "before_rmse": 0.02, "after_rmse": {"coulomb": 0.01}, "noise_rms": 0.005,
        "published_rmse": 0.007, "known": "dry friction",
        "said": {"coulomb": {"seconds": 1.0, "error": "", "findings": [], "marks": {
            "false_claims": 3, "off": {}, "errors": {}, "said": [],
            "effect_top_or_confusable": None, "location": None, "effect": None, "covered": {},
            "after": None}}},
    }  # fmt: skip
    result = CaseResult.from_json(data)
    assert result.to_json() == data
    found = summary([result], ["coulomb"])
    assert found["scores"]["coulomb"]["false_alarms"]["of"] == 0
    assert found["confusion"]["coulomb"] == {}
    assert found["machines"] == [
        {"name": "arm", "before_rmse": 0.02, "after_rmse": {"coulomb": 0.01},
         "repeat_rmse": 0.005, "findings": {"coulomb": []}, "published_rmse": 0.007,
         "known": "dry friction", "seconds": {"coulomb": 1.0}},
    ]  # fmt: skip
