"""Scores from the results of all cases: shares with intervals, medians, curves and tables."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from wt.prove import fleet_marks
from wt.prove.answer import UNKNOWN
from wt.prove.case import HiddenEffect
from wt.prove.case_result import CaseResult

SEEN = 3.0
"""Rms change of recordings over their noise from which on an effect counts as visible."""
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Shares of intervals at which coverage is compared with what it should be."""
NOTHING = "nothing"
_NOMINAL = 0.95
Scores = dict[str, Any]

TARGETS: tuple[tuple[str, float, float], ...] = (
    ("location", 0.95, 1.0), ("effect", 0.9, 1.0), ("false_alarms", 0.0, 0.02),
    ("coverage", 0.9, 0.99), ("unknown", 0.8, 1.0), ("unknown_place", 0.9, 1.0),
    ("levels", 0.95, 1.0), ("changes", 1.0, 1.0), ("false_changes", 0.0, 0.01),
)  # fmt: skip
"""Scores that are shares, and between which shares they should lie."""
BETTER: dict[str, int] = {
    "location": 1, "effect": 1, "unknown": 1, "unknown_place": 1, "false_alarms": -1,
    "extra_claims": -1, "coverage": -1, "parameter_error": -1, "improved": 1, "error_left": -1,
}  # fmt: skip
"""Scores in which contenders are compared: +1 where more is better, -1 where less is."""


@dataclass(frozen=True)
class _Claimed:
    """A hidden effect and a contender's claim at its place.

    Attributes:
        effect: the hidden effect.
        visibility: its rms change of the recordings over their noise; None where not known.
        claim: id that was said at its place; "" if nothing was.
    """

    effect: HiddenEffect
    visibility: float | None
    claim: str

    @property
    def located(self) -> bool:
        """True if anything was said at its place."""
        return self.claim != ""

    @property
    def named(self) -> bool:
        """True if the right effect was said there."""
        return self.claim == self.effect.effect

    @property
    def visible(self) -> bool:
        """True if it shows in the recordings, or its size is not known."""
        return self.visibility is None or self.visibility > SEEN

    @property
    def outsider(self) -> bool:
        """True if it is outside every vocabulary."""
        return self.effect.effect == UNKNOWN


def _claimed(results: Iterable[CaseResult], who: str) -> list[_Claimed]:
    """All hidden effects with a contender's claims at their places."""
    return [
        _Claimed(effect, visibility, claim)
        for result in results
        for effect, visibility, claim in zip(
            result.truth, result.visibility, result.marks(who).said, strict=True
        )
    ]


def scores(results: Sequence[CaseResult], who: str) -> Scores:
    """All scores of one contender. Shares are dicts of right, of, share and ci95."""
    hidden = _claimed(results, who)
    occupied = [result for result in results if result.truth]
    return {
        **_of_effects(hidden),
        "near": share(bool(r.marks(who).effect_top_or_confusable) for r in occupied),
        **_of_outsiders([effect for effect in hidden if effect.outsider]),
        **_of_claims(results, who),
        **_of_intervals(results, who),
        **heldout([result for result in results if _is_expressible(result)], who),
        **_of_fleets(results, who),
        **_of_runs(results, who),
    }


def _of_effects(hidden: Sequence[_Claimed]) -> Scores:
    """Shares of the hidden effects that were located and named."""
    visible = [claimed for claimed in hidden if claimed.visible]
    listed = [claimed for claimed in visible if not claimed.outsider]
    return {
        "location": share(claimed.located for claimed in visible),
        "effect": share(claimed.named for claimed in listed),
        "location_of_all": share(claimed.located for claimed in hidden),
        "effect_of_all": share(claimed.named for claimed in hidden),
    }


def _of_outsiders(outsiders: Sequence[_Claimed]) -> Scores:
    """Shares of the visible outsiders that were called unknown, and of those located."""
    visible = [claimed for claimed in outsiders if claimed.visible]
    return {
        "unknown": share(claimed.named for claimed in visible),
        "unknown_place": share(claimed.located for claimed in visible),
    }


def _of_claims(results: Sequence[CaseResult], who: str) -> Scores:
    """Shares of the nulls with false claims, and of the other cases with superfluous ones."""
    occupied = [result for result in results if result.truth]
    nulls = [result for result in results if result.kind == "null"]
    return {
        "false_alarms": share(result.contenders[who].false_alarm for result in nulls),
        "extra_claims": share(result.marks(who).false_claims > 0 for result in occupied),
    }


def _of_intervals(results: Sequence[CaseResult], who: str) -> Scores:
    """Coverage of the 95 % intervals, and the median error of parameters."""
    end = norm.ppf(0.5 + 0.5 * _NOMINAL)
    errors = [e for r in results for e in r.marks(who).errors.values() if math.isfinite(e)]
    return {
        "coverage": share(abs(distance) <= end for distance in _distances(results, who)),
        "parameter_error": statistics.median(errors) if errors else None,
    }


def _of_fleets(results: Sequence[CaseResult], who: str) -> Scores:
    """Shares of levels that are right, of changes that were noticed, of false ones."""
    fleets = [fleet for r in results if (fleet := r.contenders[who].fleet) is not None]
    alarms, of = (sum(f.false_alarms for f in fleets), sum(f.unit_sessions for f in fleets))
    return {
        "levels": share(true == said for f in fleets for true, said in f.levels.values()),
        "changes": share(f.noticed for f in fleets if f.errors > fleet_marks.SEEN),
        "false_changes": share(i < alarms for i in range(of)),
    }


def _of_runs(results: Sequence[CaseResult], who: str) -> Scores:
    """Experiments, median duration, and the number of diagnoses that ended in an error."""
    runs = [result.contenders[who] for result in results]
    asked = [run for run in runs if run.experiments is not None]
    return {
        "experiments": float(np.mean([r.experiments for r in asked])) if asked else None,
        "beyond_range": share(run.reach > 1.0 for run in asked),
        "seconds": statistics.median(run.seconds for run in runs) if runs else None,
        "errors": sum(bool(run.error) for run in runs),
    }


def _is_expressible(result: CaseResult) -> bool:
    """True if MJCF has elements for the hidden effects, and one of them is visible."""
    visible = any(size is None or size > SEEN for size in result.visibility)
    return result.kind != "outsider" and visible


def _distances(results: Sequence[CaseResult], who: str) -> list[float]:
    """Distances of the truth from the estimates of rightly named effects, in deviations."""
    return [distance for result in results for distance in result.marks(who).off.values()]


def heldout(results: Sequence[CaseResult], who: str) -> Scores:
    """Errors of the patched models on held-out recordings; medians over cases.

    Not for outsiders, whose force MJCF has no element for.
    """
    errors = [(result.before_rmse, result.after_rmse[who]) for result in results]
    left = [after / before for before, after in errors]
    over = [r.after_rmse[who] / r.noise_rms for r in results if r.noise_rms]
    return {
        "improved": share(after < before for before, after in errors),
        "error_left": statistics.median(left) if left else None,
        "error_over_noise": statistics.median(over) if over else None,
    }


def share(flags: Iterable[bool]) -> Scores:
    """Count of true flags among all, with Wilson's 95 % interval (1927); None of nothing."""
    outcomes = [bool(flag) for flag in flags]
    n, right = len(outcomes), sum(outcomes)
    if not n:
        return {"right": 0, "of": 0, "share": None, "ci95": None}
    z, p = float(norm.ppf(0.5 + 0.5 * _NOMINAL)), right / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * float(np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)))
    ends = [max(0.0, middle - half), min(1.0, middle + half)]
    return {"right": right, "of": n, "share": p, "ci95": ends}


def value(score: Any) -> float | None:  # noqa: ANN401 – a share or a number
    """A score as a number, be it a share or a median."""
    number = score["share"] if isinstance(score, dict) else score
    return None if number is None else float(number)


def targets(of: Scores) -> list[Scores]:
    """The targets, each with the score reached; ``met`` is None where nothing was tried."""
    outcomes = []
    for name, low, high in TARGETS:
        reached = value(of[name])
        met = None if reached is None else low <= reached <= high
        if name == "coverage" and reached is not None and reached > high:
            # few intervals that all hold do not say that they are too wide
            met = of[name]["ci95"][0] <= high
        outcomes.append({"score": name, "from": low, "to": high, "reached": reached, "met": met})
    return outcomes


def ahead(ours: Scores, theirs: Scores) -> dict[str, bool | None]:
    """Score → whether ours is better; None where they are equal, or one of both has none."""
    better: dict[str, bool | None] = {}
    for name, sign in BETTER.items():
        a, b = value(ours.get(name)), value(theirs.get(name))
        if a is None or b is None or a == b:
            better[name] = None
            continue
        if name == "coverage":  # too wide is as wrong as too narrow
            a, b = abs(a - _NOMINAL), abs(b - _NOMINAL)
        better[name] = sign * a > sign * b
    return better


def confusion(results: Sequence[CaseResult], who: str) -> dict[str, dict[str, int]]:
    """Hidden law → effect that was said at its place → count; visible ones only."""
    counts: dict[str, dict[str, int]] = {}
    for result in results:
        for law, claim in _pairs(result, who):
            of_law = counts.setdefault(law, {})
            of_law[claim] = of_law.get(claim, 0) + 1
    return counts


def _pairs(result: CaseResult, who: str) -> list[tuple[str, str]]:
    """Hidden law and claim at its place, for all visible effects of a case."""
    if result.kind == "null":
        claims = [finding["effect"] for finding in result.contenders[who].findings]
        counted = claims if result.marks(who).false_claims else []
        return [(NOTHING, claim) for claim in counted or [NOTHING]]
    claimed = [claimed for claimed in _claimed([result], who) if claimed.visible]
    return [(c.effect.law, c.claim or NOTHING) for c in claimed]


def power(results: Sequence[CaseResult], who: str) -> dict[str, list[Scores]]:
    """Law → its cases by size over noise: whether it was located and named."""
    points: dict[str, list[Scores]] = {}
    for claimed in _claimed(results, who):
        if claimed.visibility is not None:
            point = {
                "visibility": claimed.visibility,
                "located": claimed.located,
                "named": claimed.named,
            }
            points.setdefault(claimed.effect.law, []).append(point)
    return {law: sorted(cases, key=lambda p: p["visibility"]) for law, cases in points.items()}


def calibration(results: Sequence[CaseResult], who: str) -> list[Scores]:
    """Share of intervals of each size that hold the truth, if errors are normal."""
    distances = _distances(results, who)
    if not distances:
        return []
    # no finite distance: an interval of no width beside the truth
    size = np.array([abs(d) if math.isfinite(d) else np.inf for d in distances])
    return [
        {"nominal": p, "covered": float((size <= norm.ppf(0.5 + 0.5 * p)).mean())} for p in LEVELS
    ]
