"""Which of the shipped configurations are tasks of ``wt fit``."""

from __future__ import annotations

from pathlib import Path

CONF = Path(__file__).resolve().parent.parent / "conf"
OTHERS = ("base", "finetune_", "policy_")  # what tasks share; of wt-finetune, wt-train-policy
TASKS = sorted(p.name for p in CONF.glob("*.yaml") if not p.name.startswith(OTHERS))
