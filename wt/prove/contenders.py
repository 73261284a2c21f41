"""The contenders and their programs: all get the same files and write answers of one form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from wt.prove.blind import GENERATOR, ROOT

OURS = "diagnose"
RIVALS = ("sysid", "sysid-bic", "sindy", "coulomb")
"""Modules of ``wt.prove.rivals``."""
_RIVALS_OWN = ("__init__.py", "rivals", "sysid_rival.py", "sysid_ranges.py")
"""Parts of this package that rivals are made of; the rest makes worlds and answers."""
_ELSEWHERE = ("benchmarks", "build", "tests", ".git")
"""Parts of a checkout, outside the package, that reveal worlds and answers."""
LIMIT_S = 1800.0
"""Longest diagnosis [s]."""


def program(who: str, budget_s: float) -> Callable[[Sequence[str], Sequence[str]], list[str]]:
    """The command of a contender, given the names of fitted and held-out recordings.

    Args:
        who: ``diagnose`` or a rival.
        budget_s: time budget of a rival [s].
    """

    def command(fit: Sequence[str], holdout: Sequence[str]) -> list[str]:
        files = ["robot.xml", *fit, "--holdout", *holdout, "--out", "out"]
        if who == OURS:
            return ["wt.cli.main", "diagnose", *files, "--jobs", "1"]
        return ["wt.prove.rivals", who, *files, "--seconds", f"{budget_s:g}"]

    return command


def closed(who: str, *folders: Path) -> tuple[Path, ...]:
    """Paths closed to a contender: the trial's folders, and the code of worlds and answers."""
    elsewhere = [ROOT / name for name in _ELSEWHERE if (ROOT / "pyproject.toml").exists()]
    if who == OURS:
        return (GENERATOR, *elsewhere, *folders)
    parts = [part for part in GENERATOR.iterdir() if part.name not in _RIVALS_OWN]
    return (*sorted(parts), *elsewhere, *folders)


def limit(who: str, budget_s: float) -> float:
    """Time limit of a contender [s]; a rival may finish its current step."""
    return LIMIT_S if who == OURS else 1.5 * budget_s + 30.0
