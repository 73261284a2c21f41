"""The table of a fine-tuning: three figures of every variant, the paper's beside ours."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wt.evaluate import paper
from wt.finetune.evaluate import Downstream
from wt.show.files import write_together

ByVariant = Mapping[str, Mapping[int, Downstream]]
"""Figures by variant and seed."""

FIGURES = {"tracking": "rad/s", "stability": "rad", "power": "W"}
OWN = {"walking": "m/s"}
"""Not in the paper's table: what turning well may have cost."""
AIMS = {"tracking": 0.7, "stability": 1.05, "power": 1.05}
"""Upper limits that World Translation aims at, in units of no adaptation."""


def plain(
    by_variant: ByVariant,
    about: Mapping[str, object],
    updates: Mapping[str, Mapping[int, int]] | None = None,
) -> dict[str, Any]:
    """As ``results.json`` has it.

    Args:
        by_variant: the figures.
        about: task, model and whatever else says what was measured.
        updates: of each policy, by variant and seed, where that is known.
    """
    variants: dict[str, Any] = {}
    for variant, by_seed in by_variant.items():
        rows = list(by_seed.values())
        variants[variant] = {"seeds": list(by_seed)}
        if updates is not None:
            variants[variant]["updates"] = [updates[variant][seed] for seed in by_seed]
        for name in (*FIGURES, *OWN, "fallen"):
            values = [getattr(row, name) for row in rows]
            numbers = {"mean": float(np.mean(values)), "std": float(np.std(values))}
            variants[variant][name] = numbers | {"by_seed": values}
    return {
        "schema": 1,
        **about,
        "units": {**FIGURES, **OWN},
        "variants": variants,
        "paper": {v: dict(zip(FIGURES, row, strict=True)) for v, row in paper.DOWNSTREAM.items()},
        "to_none": {
            v: _ratios(variants, v) for v in variants if v != "none" and "none" in by_variant
        },
    }


def table(results: Mapping[str, Any]) -> str:
    """The figures as a Markdown table; with numbers of updates where a training was cut short."""
    short = any(_short(row, results) for row in results["variants"].values())
    head = [f"{name} [{unit}]" for name, unit in FIGURES.items()]
    lines = [
        "| variant | "
        + " | ".join(f"{h} | paper's" for h in head)
        + " | walking [m/s] | fell |"
        + " updates |" * short,
        "| --- |" + " ---: |" * (2 * len(head) + 2 + short),
    ]
    for variant, row in results["variants"].items():
        cells: list[str] = []
        for name in FIGURES:
            theirs = results["paper"].get(variant, {}).get(name)
            cells += [_spread(row[name]), "–" if theirs is None else f"{theirs:g}"]
        cells += [_spread(row["walking"]), f"{row['fallen']['mean']:.0%}"]
        if short:
            cells.append(_span(row["updates"]))
        lines.append(f"| {variant} | " + " | ".join(cells) + " |")
    aimed = {(variant, name) for variant in ("translation", "stance", "diagnosed") for name in AIMS}
    for variant, ratios in results["to_none"].items():
        said = ", ".join(
            f"{name} {ratio - 1:+.1%}"
            + (f" (aim: {AIMS[name] - 1:+.0%} at most)" if (variant, name) in aimed else "")
            for name, ratio in ratios.items()
        )
        lines.append(f"\n{variant} against none: {said}.")
    return "\n".join(lines) + "\n"


def save(results: Mapping[str, Any], folder: Path) -> None:
    """Write ``results.json`` and ``results.md``, both or neither."""
    text = json.dumps(results, indent=1, ensure_ascii=False) + "\n"
    write_together(folder, {"results.json": text, "results.md": table(results)})


def _short(row: Mapping[str, Any], results: Mapping[str, Any]) -> bool:
    """Whether policies of a variant, which were trained at all, have fewer updates than asked."""
    return 0 < min(row.get("updates", [0])) < results.get("iterations", 0)


def _span(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return f"{low}" if low == high else f"{low} to {high}"


def _ratios(variants: Mapping[str, Any], variant: str) -> dict[str, float]:
    ours, base = variants[variant], variants["none"]
    return {name: ours[name]["mean"] / base[name]["mean"] for name in (*FIGURES, *OWN)}


def _spread(numbers: Mapping[str, Sequence[float] | float]) -> str:
    by_seed = numbers["by_seed"]
    several = isinstance(by_seed, list) and len(by_seed) > 1
    return f"{numbers['mean']:.4g}" + (f" ± {numbers['std']:.2g}" if several else "")
