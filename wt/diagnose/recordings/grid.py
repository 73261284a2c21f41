"""Coarse encoders: read off the recorded values, which lie on a grid.

Every encoder has steps. Those finer than ``thresholds.encoder_step`` are what any robot has,
and no finding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from wt.diagnose.recordings.samples import Part
from wt.diagnose.result import Estimate, Finding, Located
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.units import Units
from wt.types import Location

_FEWEST = 8  # values on the grid, or nothing moved enough to tell
_OFF = 0.02  # of a step: what rounding in a file may move a value by


def coarse_steps(
    fitted: Sequence[Part], held_out: Sequence[Part], joints: Mapping[str, Units]
) -> tuple[Finding, ...]:
    """Joints whose positions were recorded in coarse steps, in the fitted and held-out parts.

    Args:
        fitted: the steps are read off these.
        held_out: … and have to be found again in these.
        joints: of the model, with their units.
    """
    findings = []
    for joint, units in joints.items():
        values = [_values(parts, joint) for parts in (fitted, held_out)]
        step = _step(values[0])
        if (
            step is None
            or step < THRESHOLDS.encoder_step
            or len(values[1]) < _FEWEST
            or _off(values[1], step)
        ):
            continue
        # by chance, a value lies so near to a grid line with this probability
        chance = min(1.0, (2.0 * _OFF) ** (len(np.unique(values[1])) - 2))
        findings.append(_finding(joint, units, step, values[0], chance))
    return tuple(findings)


def located(findings: Sequence[Finding], alone: bool) -> tuple[Located, ...]:
    """The places of coarse encoders; they share the mismatch if there is no other."""
    share = 1.0 / len(findings) if findings and alone else 0.0
    return tuple(Located(f.at, share, condition="whenever it moves, in steps") for f in findings)


def rounding(parts: Sequence[Part], joint: str) -> float:
    """Standard deviation of what coarse steps round a joint's positions by [rad or m]; or zero.

    Where a joint moves slower than a step a sample, successive samples are off by the same, so that
    noise that is estimated from differences is less than that.
    """
    step = _step(_values(parts, joint))
    return 0.0 if step is None else step / math.sqrt(12.0)


def _values(parts: Sequence[Part], joint: str) -> Float[np.ndarray, " sample"]:
    values = [np.zeros(0)]
    for p in parts:
        since = p.recording.t - p.recording.t[0]
        inside = (since >= p.span[0]) & (since < p.span[1])
        column = p.recording.columns.get(f"qpos/{joint}")
        if column is not None:
            values.append(column[inside & np.isfinite(column)])
    return np.concatenate(values)


def _step(values: Float[np.ndarray, " sample"]) -> float | None:
    """Spacing of the grid that all values lie on; None if there is none."""
    levels = np.unique(values)
    if len(levels) < _FEWEST or len(levels) > 0.5 * len(values):
        return None
    gaps = np.diff(levels)
    smallest = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    count = np.round((levels - levels[0]) / smallest)
    step = float(np.polyfit(count, levels, 1)[0])
    return None if _off(values, step) else step


def _off(values: Float[np.ndarray, " sample"], step: float) -> bool:
    """Tell whether values lie beside the grid."""
    phase = (values - values[0]) / step
    return bool(np.abs(phase - np.round(phase)).max() > _OFF)


def _finding(
    joint: str, units: Units, step: float, values: Float[np.ndarray, " sample"], chance: float
) -> Finding:
    effect, at = effects()["sensor.quantization"], Location("joint", joint)
    # any step within this of the estimate keeps all values on the grid
    spread = step * _OFF / max(float(np.ptp(values)) / step, 1.0)
    return Finding(
        effect=effect.id,
        at=at,
        parameters={"step": Estimate(step, units.position, (step - spread, step + spread))},
        statement=effect.statement(at, np.array([step]), units),
        holdout_gain=0.0,
        p_value=chance,
        reference=effect.reference,
    )
