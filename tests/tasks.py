"""Which of the shipped configurations are tasks of ``wt fit``."""

from __future__ import annotations

from pathlib import Path

CONF = Path(__file__).resolve().parent.parent / "conf"
OTHERS = ("base", "policy_")  # what the tasks share, and what wt-train-policy reads
TASKS = sorted(p.name for p in CONF.glob("*.yaml") if not p.name.startswith(OTHERS))
