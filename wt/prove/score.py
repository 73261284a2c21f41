"""Marking: a diagnosis, as its JSON, against what was hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wt.prove.cases import Case, Truth
from wt.prove.rigs import RIGS

Finding = Mapping[str, Any]

PARAMETERS: dict[str, tuple[str, ...]] = {
    "joint.friction_coulomb": ("coulomb",),
    "joint.friction_viscous": ("coefficient",),
    "joint.friction_quadratic": ("coefficient",),
    "joint.friction_stribeck": ("coulomb", "static", "velocity"),
    "joint.friction_load": ("coulomb", "fraction"),
    "joint.stiffness": ("stiffness", "reference"),
    "joint.armature": ("inertia",),
    "joint.backlash": ("gap",),
    "joint.elasticity": ("stiffness", "damping"),
    "joint.hysteresis": ("stiffness", "yield"),
    "joint.stop": ("position", "side"),
    "actuator.gain": ("factor",),
    "actuator.bias": ("torque",),
    "actuator.delay": ("delay",),
    "actuator.lag": ("time_constant",),
    "actuator.saturation": ("torque",),
    "actuator.speed_limit": ("stall", "speed"),
    "actuator.deadband": ("width",),
    "actuator.ripple": ("amplitude", "cycles", "phase"),
    "actuator.fade": ("loss", "time_constant"),
    "body.mass": ("factor",),
    "body.com": ("shift",),
    "body.inertia": ("factor",),
    "body.payload_fixed": ("mass", "position"),
    "body.force": ("force",),
    "body.force_intermittent": ("force",),
    "body.drag": ("coefficient",),
    "body.tether": ("stiffness", "anchor"),
    "sensor.offset": ("offset",),
    "sensor.scale": ("factor",),
    "sensor.delay": ("delay",),
    "sensor.quantization": ("step",),
    "world.gravity": ("angle", "direction"),
}
"""Parameters that are marked. Windows are not, nor what an effect needs inside these worlds."""

ANGLES = ("phase", "direction")
"""Parameters that are the same a turn later."""


@dataclass(frozen=True)
class Score:
    """Marks of one case.

    Attributes:
        location: the first findings are at the hidden places; None for a null.
        effect: and have the right ids (``unknown`` for an outsider); None for a null.
        effect_top_or_confusable: the right id is the finding's or among its ``confusable_with``.
        false_claims: findings in a null; elsewhere findings beyond the hidden ones.
        errors: parameter → relative error, of rightly named effects. Of vectors the length of the
            difference over the length; of angles the difference [rad].
        covered: parameter → whether its 95 % interval holds the truth, where one was given.
        after: held-out RMSE after over the noise floor; NaN where none was given.
    """

    location: bool | None
    effect: bool | None
    effect_top_or_confusable: bool | None
    false_claims: int
    errors: Mapping[str, float] = field(default_factory=dict)
    covered: Mapping[str, bool] = field(default_factory=dict)
    after: float = float("nan")


def score(diagnosis: Mapping[str, Any], case: Case) -> Score:
    """Mark a diagnosis.

    As many findings as effects were hidden are looked at, from the first on, each against the
    truth at its place.

    Args:
        diagnosis: the diagnosis JSON as a dict.
        case: what was hidden.
    """
    findings: Sequence[Finding] = diagnosis["findings"]
    after = _after(diagnosis)
    if not case.truth:
        return Score(None, None, None, len(findings), after=after)
    first = list(findings[: len(case.truth)])
    found = _match(case, first)
    named = {i: f for i, f in found.items() if f["effect"] == case.truth[i].effect}
    errors: dict[str, float] = {}
    covered: dict[str, bool] = {}
    for i, finding in named.items():
        _mark_parameters(case.truth[i], finding, errors, covered)
    every = range(len(case.truth))
    return Score(
        location=len(found) == len(case.truth),
        effect=len(named) == len(case.truth),
        effect_top_or_confusable=all(
            i in found and case.truth[i].effect in _names(found[i]) for i in every
        ),
        false_claims=max(len(findings) - len(case.truth), 0),
        errors=errors,
        covered=covered,
        after=after,
    )


def _match(case: Case, findings: list[Finding]) -> dict[int, Finding]:
    """Truth index → the finding at its place, those with the right effect first."""
    found: dict[int, Finding] = {}
    left = list(findings)
    for exact in (True, False):
        for i, truth in enumerate(case.truth):
            for finding in left:
                right = not exact or finding["effect"] == truth.effect
                if i not in found and right and same_place(case, truth, finding):
                    found[i] = finding
                    left.remove(finding)
                    break
    return found


def same_place(case: Case, truth: Truth, finding: Finding) -> bool:
    """Whether a finding is where the truth is.

    A joint and the actuator that drives it are one place, as are a pair in either order, and a
    joint or its encoder. Bodies must be exact: no rig has two of its own bodies welded together.
    """
    at = (finding["at"]["kind"], finding["at"]["name"])
    right = [(truth.kind, truth.name), *truth.accept]
    return _canonical(case, *at) in [_canonical(case, *place) for place in right]


def _canonical(case: Case, kind: str, name: str) -> tuple[str, str]:
    rig = RIGS[case.rig]
    if name in rig.actuators:
        return "joint", name.removesuffix("_drive")
    if kind == "sensor" and name == "encoder":
        return "joint", rig.joints[0]
    if kind == "pair" or "+" in name:
        return "pair", "+".join(sorted(part.removesuffix("_drive") for part in name.split("+")))
    if name in rig.joints:
        return "joint", name
    if name in ("all", "world"):
        return "whole", name
    return kind, name


def _names(finding: Finding) -> list[str]:
    return [finding["effect"], *(c["effect"] for c in finding.get("confusable_with", []))]


def _mark_parameters(
    truth: Truth, finding: Finding, errors: dict[str, float], covered: dict[str, bool]
) -> None:
    for name in PARAMETERS.get(truth.effect, ()):
        said = finding["parameters"].get(name)
        if said is None:
            continue
        key = f"{truth.effect}.{name}"
        right = np.atleast_1d(np.asarray(truth.parameters[name], dtype=float))
        value = np.atleast_1d(np.asarray(said["value"], dtype=float))
        if value.shape != right.shape:
            errors[key] = float("inf")
            continue
        error = value - right
        if name in ANGLES:
            error = (error + np.pi) % (2 * np.pi) - np.pi
            errors[key] = float(np.abs(error).max())
        else:
            errors[key] = float(np.linalg.norm(error)) / max(float(np.linalg.norm(right)), 1e-12)
        ci = said.get("ci95")
        if ci is not None and name != "side":
            inside = _inside(np.asarray(ci, dtype=float), value, right, error)
            if inside is not None:
                covered[key] = inside


def _inside(ci: np.ndarray, value: np.ndarray, right: np.ndarray, error: np.ndarray) -> bool | None:
    """Whether intervals hold the truth, for all elements; [low, high] or one such pair each."""
    if ci.shape == (2,) and right.size == 1:
        ci = ci[None]
    if ci.shape != (right.size, 2):
        ci = ci.T
    if ci.shape != (right.size, 2):
        return None
    # an angle is compared near the said value, wherever the turn was cut
    near = value - error
    return bool(((ci[:, 0] <= near) & (near <= ci[:, 1])).all())


def _after(diagnosis: Mapping[str, Any]) -> float:
    holdout = (diagnosis.get("fit") or {}).get("holdout") or {}
    after, floor = holdout.get("after_rmse"), holdout.get("noise_floor_rmse")
    return float(after) / float(floor) if after is not None and floor else float("nan")
