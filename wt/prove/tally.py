"""From the rows of all cases to scores: shares with intervals, medians, curves and tables."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import norm

from wt.prove.answer import UNKNOWN
from wt.prove.marks import Row

SEEN = 3.0
"""An effect counts as visible if it changes recordings by more than so many times their noise."""
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Shares of intervals at which coverage is compared with what it should be."""
NOTHING = "nothing"
_NOMINAL = 0.95
Scores = dict[str, Any]

TARGETS: tuple[tuple[str, float, float], ...] = (
    ("location", 0.95, 1.0), ("effect", 0.9, 1.0), ("false_alarms", 0.0, 0.02),
    ("coverage", 0.9, 0.99), ("unknown", 0.8, 1.0), ("unknown_place", 0.9, 1.0),
)  # fmt: skip
"""Scores that are shares, and between which shares they should lie."""
BETTER: dict[str, int] = {
    "location": 1, "effect": 1, "unknown": 1, "unknown_place": 1, "false_alarms": -1,
    "extra_claims": -1, "coverage": -1, "parameter_error": -1, "improved": 1, "error_left": -1,
}  # fmt: skip
"""Scores in which contenders are compared: +1 where more is better, -1 where less is."""


def scores(rows: Sequence[Row], who: str) -> Scores:
    """All scores of one contender. Shares are dicts of right, of, share and ci95."""
    hidden = [(row, i) for row in rows for i in range(len(row["truth"]))]
    visible = [(row, i) for row, i in hidden if _visible(row["truth"][i])]
    listed = [(r, i) for r, i in visible if r["truth"][i]["effect"] != UNKNOWN]
    outside = [(r, i) for r, i in visible if r["truth"][i]["effect"] == UNKNOWN]
    nulls = [row for row in rows if row["kind"] == "null"]
    others = [row for row in rows if row["truth"]]
    off = [d for row in rows for d in _marks(row, who)["off"].values()]
    errors = [e for row in rows for e in _marks(row, who)["errors"].values() if e is not None]
    return {
        "location": share(_said(r, i, who) != "" for r, i in visible),
        "effect": share(_named(r, i, who) for r, i in listed),
        "location_of_all": share(_said(r, i, who) != "" for r, i in hidden),
        "effect_of_all": share(_named(r, i, who) for r, i in hidden),
        "near": share(bool(_marks(r, who)["effect_top_or_confusable"]) for r in others),
        "unknown": share(_named(r, i, who) for r, i in outside),
        "unknown_place": share(_said(r, i, who) != "" for r, i in outside),
        # an error is no silence
        "false_alarms": share(
            _marks(r, who)["false_claims"] > 0 or bool(r["said"][who]["error"]) for r in nulls
        ),
        "extra_claims": share(_marks(r, who)["false_claims"] > 0 for r in others),
        "coverage": share(d is not None and abs(d) <= norm.ppf(0.5 + 0.5 * _NOMINAL) for d in off),
        "parameter_error": statistics.median(errors) if errors else None,
        **heldout(
            [r for r in others if r["kind"] != "outsider" and any(map(_visible, r["truth"]))], who
        ),
        "seconds": statistics.median(r["said"][who]["seconds"] for r in rows) if rows else None,
        "errors": sum(bool(row["said"][who]["error"]) for row in rows),
    }


def heldout(rows: Sequence[Row], who: str) -> Scores:
    """How replays of held-out recordings fare on the patched models; medians over cases.

    Not of outsiders, whose force MJCF has no element for.
    """
    pairs = [(row["before_rmse"], row["after_rmse"][who], row["noise_rms"]) for row in rows]
    over = [after / noise for _, after, noise in pairs if noise]
    return {
        "improved": share(after < before for before, after, _ in pairs),
        "error_left": statistics.median(after / before for before, after, _ in pairs)
        if pairs
        else None,
        "error_over_noise": statistics.median(over) if over else None,
    }


def share(flags: Iterable[bool]) -> Scores:
    """How many of how many, with Wilson's 95 % interval (1927); None of nothing."""
    every = [bool(flag) for flag in flags]
    n, right = len(every), sum(every)
    if not n:
        return {"right": 0, "of": 0, "share": None, "ci95": None}
    z, p = float(norm.ppf(0.5 + 0.5 * _NOMINAL)), right / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * float(np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)))
    ends = [max(0.0, middle - half), min(1.0, middle + half)]
    return {"right": right, "of": n, "share": p, "ci95": ends}


def value(score: Any) -> float | None:  # noqa: ANN401 – a share or a number
    """A score as a number, be it a share or a median."""
    found = score["share"] if isinstance(score, dict) else score
    return None if found is None else float(found)


def targets(of: Scores) -> list[Scores]:
    """Which targets are met; None where nothing was tried."""
    found = []
    for name, low, high in TARGETS:
        reached = value(of[name])
        met = None if reached is None else low <= reached <= high
        if name == "coverage" and reached is not None and reached > high:
            # few intervals that all hold do not say that they are too wide
            met = of[name]["ci95"][0] <= high
        found.append({"score": name, "from": low, "to": high, "reached": reached, "met": met})
    return found


def ahead(ours: Scores, theirs: Scores) -> dict[str, bool | None]:
    """Score → whether ours is better; None where they are equal, or one of both has none."""
    found: dict[str, bool | None] = {}
    for name, sign in BETTER.items():
        a, b = value(ours.get(name)), value(theirs.get(name))
        if a is None or b is None or a == b:
            found[name] = None
            continue
        if name == "coverage":  # too wide is as wrong as too narrow
            a, b = abs(a - _NOMINAL), abs(b - _NOMINAL)
        found[name] = sign * a > sign * b
    return found


def confusion(rows: Sequence[Row], who: str) -> dict[str, dict[str, int]]:
    """Law that is hidden → effect that was said at its place → how often; visible ones only."""
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        pairs = [
            (truth["law"], _said(row, i, who) or NOTHING)
            for i, truth in enumerate(row["truth"])
            if _visible(truth)
        ]
        if row["kind"] == "null":
            said = [finding["effect"] for finding in row["said"][who]["findings"]]
            claimed = said if _marks(row, who)["false_claims"] else []
            pairs = [(NOTHING, one) for one in claimed or [NOTHING]]
        for hidden, said_there in pairs:
            inner = found.setdefault(hidden, {})
            inner[said_there] = inner.get(said_there, 0) + 1
    return found


def power(rows: Sequence[Row], who: str) -> dict[str, list[Scores]]:
    """Law → its cases by size over noise: whether it was located and named."""
    found: dict[str, list[Scores]] = {}
    for row in rows:
        for i, truth in enumerate(row["truth"]):
            if truth["visibility"] is not None:
                point = {
                    "visibility": truth["visibility"],
                    "located": _said(row, i, who) != "",
                    "named": _named(row, i, who),
                }
                found.setdefault(truth["law"], []).append(point)
    return {law: sorted(some, key=lambda p: p["visibility"]) for law, some in found.items()}


def calibration(rows: Sequence[Row], who: str) -> list[Scores]:
    """How often intervals of each size hold the truth, as far as normal errors would have it."""
    off = [d for row in rows for d in _marks(row, who)["off"].values()]
    if not off:
        return []
    # no finite distance: an interval of no width beside the truth
    size = np.array([np.inf if d is None else abs(d) for d in off])
    return [
        {"nominal": p, "covered": float((size <= norm.ppf(0.5 + 0.5 * p)).mean())} for p in LEVELS
    ]


def _marks(row: Row, who: str) -> Scores:
    found: Scores = row["said"][who]["marks"]
    return found


def _said(row: Row, index: int, who: str) -> str:
    found: str = _marks(row, who)["said"][index]
    return found


def _named(row: Row, index: int, who: str) -> bool:
    return _said(row, index, who) == row["truth"][index]["effect"]


def _visible(truth: Scores) -> bool:
    """Sizes that nobody knows are taken to be visible."""
    return truth["visibility"] is None or truth["visibility"] > SEEN
