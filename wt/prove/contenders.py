"""The contenders and their programs: all get the same files and write answers of one form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from wt.prove.blind import GENERATOR, ROOT

OURS = "diagnose"
ASK = "ask"
ASKING = (ASK, "multisines", "once")
"""Of machines that can be asked: ``wt ask``; ``wt diagnose`` of as many multisines as that asked
for; and of the recording that there was."""
PASSPORT = "passport"
"""Of fleets: ``wt passport``."""
OWN = (OURS, *ASKING, PASSPORT)
RIVALS = ("sysid", "sysid-bic", "sindy", "coulomb")
"""Modules of ``wt.prove.rivals``."""
_RIVALS_OWN = ("__init__.py", "rivals", "sysid_rival.py", "sysid_ranges.py")
"""Parts of this package that rivals are made of; the rest makes worlds and answers."""
_ELSEWHERE = ("benchmarks", "build", "tests", ".git")
"""Parts of a checkout, outside the package, that reveal worlds and answers."""
LIMIT_S = 1800.0
"""Longest diagnosis [s]."""
FLEET_LIMIT_S = 4.0 * 3600.0
"""Longest passport of a fleet [s]."""


def of_set(name: str, rivals: bool) -> tuple[str, ...]:
    """Who competes on a set."""
    if name == "ask":
        return ASKING
    if name == "fleet":
        return (PASSPORT,)
    return (OURS, *RIVALS) if rivals else (OURS,)


def program(
    who: str, budget_s: float, experiments: int = 0
) -> Callable[[Sequence[str], Sequence[str]], list[str]]:
    """The command of a contender, given the names of fitted and held-out recordings.

    Args:
        who: one of :data:`OWN`, or a rival.
        budget_s: time budget of a rival [s].
        experiments: that were asked for, so many multisines has the control.
    """

    def command(fit: Sequence[str], holdout: Sequence[str]) -> list[str]:
        if who == PASSPORT:
            how = ["--each-session", "--search", "first", "--out", "out"]
            return ["wt.cli.main", "passport", "add", "robot.xml", *fit, *how]
        first, sines = fit[0], fit[1 : 1 + experiments]
        if who == ASK:
            asked = ["robot.xml", first, "--robot", "file", "--whole-range", "--out", "out"]
            return ["wt.cli.main", "ask", *asked]
        if who in ASKING:
            files = ["robot.xml", first, "--out", "out"]
            if who == "multisines" and sines:
                files = ["robot.xml", *sines, "--holdout", first, "--out", "out"]
            return ["wt.cli.main", "diagnose", *files, "--jobs", "1"]
        files = ["robot.xml", *fit, "--holdout", *holdout, "--out", "out"]
        if who == OURS:
            return ["wt.cli.main", "diagnose", *files, "--jobs", "1"]
        return ["wt.prove.rivals", who, *files, "--seconds", f"{budget_s:g}"]

    return command


def product(who: str) -> str:
    """What a contender writes if all goes well, in its folder."""
    return {ASK: "out/diagnosis/diagnosis.json", PASSPORT: "out/0001-*.json"}.get(
        who, "out/diagnosis.json"
    )


def closed(who: str, *folders: Path) -> tuple[Path, ...]:
    """Paths closed to a contender: the trial's folders, and the code of worlds and answers."""
    elsewhere = [ROOT / name for name in _ELSEWHERE if (ROOT / "pyproject.toml").exists()]
    if who in OWN:
        return (GENERATOR, *elsewhere, *folders)
    parts = [part for part in GENERATOR.iterdir() if part.name not in _RIVALS_OWN]
    return (*sorted(parts), *elsewhere, *folders)


def limit(who: str, budget_s: float) -> float:
    """Time limit of a contender [s]; a rival may finish its current step."""
    if who == PASSPORT:
        return FLEET_LIMIT_S
    return LIMIT_S if who in OWN else 1.5 * budget_s + 30.0
