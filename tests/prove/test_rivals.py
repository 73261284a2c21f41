"""Rivals find what they are made for, and say it in the form of a diagnosis."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest

from wt.data import recording
from wt.prove import contenders
from wt.prove.cases import Case, HiddenEffect
from wt.prove.rivals.__main__ import RIVALS, main
from wt.prove.score import score
from wt.prove.sensing import Sensing
from wt.prove.world import build

SENSING = Sensing(rate=200.0, bits=17, noise=5e-5, qvel="none")


def case(effect: str, **parameters: object) -> Case:
    truth = HiddenEffect(effect, "joint", "hinge", dict(parameters), effect)
    motions = ("multisine", "chirp", "triangle")
    return Case("x", "pendulum", 3, "single", (truth,), SENSING, motions, 4.0)


DRY = case("joint.friction_coulomb", coulomb=0.6)


@pytest.fixture(scope="module")
def of_friction(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, Any]]:
    """What a rival says of dry friction, once."""

    @functools.cache
    def of(rival: str) -> dict[str, Any]:
        return says(rival, DRY, tmp_path_factory.mktemp(rival))

    return of


def says(rival: str, hidden: Case, folder: Path) -> dict[str, Any]:
    """What a rival says of a case."""
    world = build(hidden)
    (folder / "robot.xml").write_text(world.nominal_xml)
    files = [folder / f"{name}.parquet" for name in ("a", "b", "held")]
    for file, one in zip(files, (*world.fit, *world.holdout), strict=True):
        recording.write(one, file)
    words = [rival, str(folder / "robot.xml"), *map(str, files[:2]), "--holdout", str(files[2])]
    assert main([*words, "--out", str(folder / "out"), "--seconds", "20"]) == 0
    mujoco.MjModel.from_xml_path(str(folder / "out" / "model.xml"))
    found: dict[str, Any] = json.loads((folder / "out" / "diagnosis.json").read_text())
    return found


def test_all_of_them_compete() -> None:
    assert tuple(RIVALS) == contenders.RIVALS


@pytest.mark.parametrize("rival", ["sysid", "sysid-bic", "coulomb"])
def test_dry_friction(rival: str, of_friction: Callable[[str], dict[str, Any]]) -> None:
    marks = score(of_friction(rival), DRY)
    assert marks.effect
    assert marks.errors["joint.friction_coulomb.coulomb"] < 0.15


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        ("joint.friction_viscous", {"coefficient": 0.7}),
        ("joint.stiffness", {"stiffness": 4.0, "reference": 0.3}),
    ],
)
def test_sparse_regression(effect: str, parameters: dict[str, float], tmp_path: Path) -> None:
    hidden = case(effect, **parameters)
    marks = score(says("sindy", hidden, tmp_path), hidden)
    assert marks.effect
    assert max(marks.errors.values()) < 0.2


def test_dropping_what_says_little(of_friction: Callable[[str], dict[str, Any]]) -> None:
    assert len(of_friction("sysid-bic")["findings"]) <= len(of_friction("sysid")["findings"])
