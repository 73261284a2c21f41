"""Errors are told in the unit of each joint, also where hinges and slides are compared together."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from tests.diagnose import synthetic
from wt.diagnose.report import text
from wt.diagnose.report.page import report
from wt.diagnose.result import Diagnosis

PLAIN = re.compile(r"<[^>]*>")


def with_units(folder: Path, *units: str) -> Diagnosis:
    """The friction of the arm, as if its joints were of other kinds."""
    path = synthetic.write_model(folder)
    hinges = synthetic.diagnosis(str(path))
    ahead = dict.fromkeys(units or ("rad",), hinges.proof.horizons["rad"])
    proof = dataclasses.replace(hinges.proof, horizons=ahead)
    return dataclasses.replace(hinges, units=units, proof=proof)


def test_all_slides_are_in_metres(tmp_path: Path) -> None:
    slides = with_units(tmp_path, "m", "m")
    said = slides.to_json()["fit"]["holdout"]
    assert said["unit"] == "m" and {e["unit"] for e in said["joints"].values()} == {"m"}
    assert "mm" in text.fit(slides) and "rad" not in text.fit(slides)
    page = PLAIN.sub(" ", report(slides).partition("What the patch changes")[0])
    page = page.partition("</style>")[2] or page
    assert "error of j2 [mm]" in page or "error of j2 [m]" in page
    assert "missing force [N]" in page and "velocity of j2 [m/s]" in page
    assert "mrad" not in page


def test_hinges_stay_as_they_were(tmp_path: Path) -> None:
    assert with_units(tmp_path).unit == with_units(tmp_path, "rad", "rad").unit == "rad"
    assert text.fit(with_units(tmp_path)) == text.fit(with_units(tmp_path, "rad", "rad"))
    assert "hinges" not in text.fit(with_units(tmp_path))


def test_a_mixture_says_each(tmp_path: Path) -> None:
    mixed = with_units(tmp_path, "m", "rad")
    said = mixed.to_json()["fit"]["holdout"]
    assert {j: e["unit"] for j, e in said["joints"].items()} == {"j1": "m", "j2": "rad"}
    assert said["unit"] == "rad"
    j1, j2 = (mixed.proof.joints[j] for j in ("j1", "j2"))
    errors = {unit: error for error, unit in text.overall(mixed)}
    assert errors["m"].before == pytest.approx(j1.before)
    assert errors["rad"].after == pytest.approx(j2.after)
    assert "(slides)" in text.fit(mixed) and "(hinges)" in text.fit(mixed)
    page = PLAIN.sub(" ", report(mixed))
    assert re.search(r"j1 \[m?µ?m\]", page) and re.search(r"j2 \[m?µ?rad\]", page)


def test_the_unit_is_that_of_the_joints_that_were_compared(tmp_path: Path) -> None:
    """A joint whose position nobody measured says nothing of the error."""
    mixed = with_units(tmp_path, "m", "rad")
    proof = dataclasses.replace(mixed.proof, joints={"j1": mixed.proof.joints["j1"]})
    assert dataclasses.replace(mixed, proof=proof).unit == "m"
