"""The page of a trial: everything is on it, and nothing of others' is taken for markup."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import pytest

from wt.prove import results
from wt.prove.case_result import CaseResult
from wt.prove.film import telling
from wt.prove.page import page

US, THEM = "diagnose", "coulomb"
DRY = "joint.friction_coulomb"


def result(name: str, kind: str, said: str = "", false: int = 0, **rest: object) -> CaseResult:
    """A case with one hidden effect, or none."""
    at = {"kind": "joint", "name": "j"}
    hidden = kind not in ("null", "real")
    law = "outsider.detent" if kind == "outsider" else DRY
    size = rest.pop("size", 20.0)
    truth = [{"law": law, "effect": "unknown" if kind == "outsider" else law, "at": at,
              "visibility": size}]  # fmt: skip
    right = said == truth[0]["effect"]

    def answer(said: str, false: int) -> dict[str, Any]:
        findings = [{"effect": effect, "at": at} for effect in [said] * bool(said) + [DRY] * false]
        marks = {"said": [said] * hidden, "false_claims": false, "errors": {}, "off": {"p": 0.3},
                 "covered": {}, "after": None,
                 "effect_top_or_confusable": right, "effect": right and hidden,
                 "location": bool(said) and hidden}  # fmt: skip
        return {"seconds": 9.0, "error": "", "findings": findings, "marks": marks}

    data = {
        "id": f"case-{name}", "name": name, "kind": kind, "rig": "arm", "level": "", "decoy": "",
        "truth": truth if hidden else [], "noise_rms": 1e-3, "published_rmse": None,
        "known": "", "before_rmse": 0.02,
        "after_rmse": {US: 0.002, THEM: 0.02},
        "said": {US: answer(said, false), THEM: answer(DRY, 0)},
    } | rest  # fmt: skip
    return CaseResult.from_json(data)


RESULTS = [
    result("dry", "single", DRY),
    result("small", "single", DRY, size=4.0),
    result("missed", "single", size=50.0),
    result("magnet", "outsider", "unknown"),
    result("alarm", "null", false=1),
    result("decoy", "null", decoy="tight_servo"),
    result("<b>arm</b>", "real", rig="<b>arm</b>", published_rmse=0.001, known="it is <dry>"),
]


def scored() -> results.Results:
    head = {"set": "full", "seed": 0, "guard": "audit", "code": "ab" * 32, "code_changed": False}
    return (
        head
        | results.summary(RESULTS, (US, THEM))
        | {"cases": [case.to_json() for case in RESULTS]}
    )


class Balance(HTMLParser):
    """Open elements, and the page's words."""

    VOID = ("meta", "br")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words = ""

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: object) -> None:
        """``<path/>`` opens nothing."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data + " "


def test_everything_is_on_the_page() -> None:
    shown = Balance()
    shown.feed(page(scored()))
    assert shown.open == []
    said = " ".join(shown.words.split())
    for expected in ("Found the place of 3 of 4 hidden effects, and named 2 of 3",
                     "Accused 1 of 2 machines", "wt diagnose", "coulomb", "outsider.detent",
                     "false alarm", "missed", "silent", "Python's audit hook", "<b>arm</b>",
                     "20.0", "Calibration"):  # fmt: skip
        assert expected in said, expected


def test_the_table_fits_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    console = Console(width=80)
    console.print(results.table(scored()))
    real = results.machines(scored())
    assert real is not None
    console.print(real)
    printed = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in printed)
    effect = next(line.split() for line in printed if line.startswith("right effect"))
    assert effect[2:] == ["3", "67", "%", "100", "%"]


def test_the_most_telling_cases_are_one_of_each_kind() -> None:
    chosen = {why: case.name for why, case in telling(RESULTS, US)}
    assert chosen == {
        "explained best": "dry",
        "smallest effect that was named": "small",
        "outside the vocabulary": "magnet",
        "decoy that was resisted": "decoy",
        "missed": "missed",
        "false alarm": "alarm",
    }
