"""Who competes, and how each is started: all get the same files, and say what they found alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from wt.prove.blind import GENERATOR, ROOT

OURS = "diagnose"
RIVALS = ("sysid", "sysid-bic", "sindy", "coulomb")
"""Modules of ``wt.prove.rivals``."""
_RIVALS_OWN = ("__init__.py", "rivals", "sysid_rival.py", "sysid_ranges.py")
"""What of this package a rival is made of; the rest makes worlds and answers."""
_BESIDE = ("benchmarks", "build", "tests", ".git")
"""What of a checkout tells of worlds and answers, beside the package."""
LIMIT_S = 1800.0
"""Longest diagnosis [s]."""


def program(who: str, budget_s: float) -> Callable[[Sequence[str], Sequence[str]], list[str]]:
    """What runs a contender, given the names of fitted and held-out recordings.

    Args:
        who: ``diagnose`` or a rival.
        budget_s: time that a rival has [s].
    """

    def command(fit: Sequence[str], holdout: Sequence[str]) -> list[str]:
        files = ["robot.xml", *fit, "--holdout", *holdout, "--out", "out"]
        if who == OURS:
            return ["wt.cli.main", "diagnose", *files, "--jobs", "1"]
        return ["wt.prove.rivals", who, *files, "--seconds", f"{budget_s:g}"]

    return command


def closed(who: str, *folders: Path) -> tuple[Path, ...]:
    """What a contender may not see: the trial's folders, and what makes worlds and answers."""
    beside = [ROOT / name for name in _BESIDE if (ROOT / "pyproject.toml").exists()]
    if who == OURS:
        return (GENERATOR, *beside, *folders)
    parts = [part for part in GENERATOR.iterdir() if part.name not in _RIVALS_OWN]
    return (*sorted(parts), *beside, *folders)


def limit(who: str, budget_s: float) -> float:
    """After how long a contender is ended [s]; a rival may finish the step that it is at."""
    return LIMIT_S if who == OURS else 1.5 * budget_s + 30.0
