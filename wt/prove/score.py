"""Marks of a diagnosis, as its JSON, against the hidden effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from wt.prove import machine
from wt.prove.cases import Case, HiddenEffect
from wt.prove.machine import Machine
from wt.prove.rigs import RIGS

Finding = Mapping[str, Any]

PARAMETERS: dict[str, tuple[str, ...]] = {
    "joint.friction_coulomb": ("coulomb",),
    "joint.friction_viscous": ("coefficient",),
    "joint.friction_quadratic": ("coefficient",),
    "joint.friction_stribeck": ("coulomb", "static", "velocity"),
    "joint.friction_load": ("coulomb", "fraction"),
    "joint.gear_loss": ("drive", "back", "coulomb", "viscous"),
    "joint.stiffness": ("stiffness", "reference"),
    "joint.armature": ("inertia",),
    "joint.backlash": ("gap",),
    "joint.elasticity": ("stiffness", "damping"),
    "joint.hysteresis": ("stiffness", "yield"),
    "joint.stop": ("position", "side"),
    "actuator.gain": ("factor",),
    "actuator.damping": ("factor",),
    "actuator.feedforward": ("coefficient",),
    "actuator.integral": ("ki",),
    "actuator.slew_rate": ("speed",),
    "actuator.profile": ("speed", "acceleration"),
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
    "body.payload_moving": ("mass", "travel"),
    "contact.friction": ("friction",),
    "contact.compliance": ("time_constant",),
    "contact.slope": ("angle",),
    "contact.obstacle": ("position", "normal"),
    "sensor.offset": ("offset",),
    "sensor.scale": ("factor",),
    "sensor.delay": ("delay",),
    "sensor.quantization": ("step",),
    "world.gravity": ("angle", "direction"),
    "world.gravity_compensation": ("share",),
    "joint.force_intermittent": (),
    "joint.friction_directional": (
        "coulomb_forward",
        "coulomb_backward",
        "viscous_forward",
        "viscous_backward",
    ),
    "pair.crosstalk": ("fraction",),
    "pair.spring": ("stiffness", "ratio", "reference"),
}
"""Parameters that are marked. Windows are not, nor what an effect needs inside these worlds."""

ANGLES = ("phase", "direction")
"""Parameters that are the same a turn later."""
FACES = ("contact.obstacle.position",)
"""Points on a face, of which only the distance from it counts."""
_END = 1.959964
"""Standard deviations from the middle of a normal distribution to the end of its middle 95 %."""


@dataclass(frozen=True)
class CaseScore:
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
        said: for each hidden effect the claim at its place, "" if there is none.
        off: parameter → distance of the truth from the estimate in standard deviations, taken
            from the end of the 95 % interval on the truth's side; of vectors ``name[i]``.
    """

    location: bool | None
    effect: bool | None
    effect_top_or_confusable: bool | None
    false_claims: int
    errors: Mapping[str, float] = field(default_factory=dict)
    covered: Mapping[str, bool] = field(default_factory=dict)
    after: float = float("nan")
    said: tuple[str, ...] = ()
    off: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """As in ``results.json``, but for numbers that are not finite."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CaseScore:
        """Read the marks of ``results.json``, where None stands for a number without end."""

        def endless(values: Mapping[str, float | None]) -> dict[str, float]:
            return {name: np.inf if v is None else float(v) for name, v in values.items()}

        after = data["after"]
        return cls(
            **{key: data[key] for key in ("location", "effect", "effect_top_or_confusable")},
            false_claims=data["false_claims"],
            errors=endless(data["errors"]),
            covered=data["covered"],
            after=float("nan") if after is None else float(after),
            said=tuple(data["said"]),
            off=endless(data["off"]),
        )


def score(diagnosis: Mapping[str, Any], case: Case) -> CaseScore:
    """Mark a diagnosis.

    As many findings as effects were hidden are looked at, from the first on, each against the
    truth at its place.

    Args:
        diagnosis: the diagnosis JSON as a dict.
        case: the case, with its hidden effects.
    """
    return mark(diagnosis, case.truth, machine.of_rig(RIGS[case.rig]), case.excused)


def mark(
    diagnosis: Mapping[str, Any],
    truth: Sequence[HiddenEffect],
    names: Machine,
    excused: Sequence[tuple[str, str, str]] = (),
) -> CaseScore:
    """Mark a diagnosis against the effects hidden in a machine.

    Args:
        diagnosis: the diagnosis JSON as a dict.
        truth: the hidden effects.
        names: the machine's names, and which are one place.
        excused: (effect, kind, name) that may be claimed beyond them.
    """
    findings = [
        finding
        for finding in diagnosis["findings"]
        if (finding["effect"], finding["at"]["kind"], finding["at"]["name"]) not in excused
    ]
    after = _after(diagnosis)
    if not truth:
        return CaseScore(None, None, None, len(findings), after=after)
    matches = _match(truth, names, findings[: len(truth)])
    named = {i: f for i, f in matches.items() if f["effect"] == truth[i].effect}
    errors: dict[str, float] = {}
    covered: dict[str, bool] = {}
    off: dict[str, float] = {}
    for i, finding in named.items():
        _mark_parameters(truth[i], finding, errors, covered, off)
    indices = range(len(truth))
    return CaseScore(
        location=len(matches) == len(truth),
        effect=len(named) == len(truth),
        effect_top_or_confusable=all(
            i in matches and truth[i].effect in _names(matches[i]) for i in indices
        ),
        false_claims=max(len(findings) - len(truth), 0),
        errors=errors,
        covered=covered,
        after=after,
        said=tuple(matches[i]["effect"] if i in matches else "" for i in indices),
        off=off,
    )


def _match(
    truth: Sequence[HiddenEffect], names: Machine, findings: Sequence[Finding]
) -> dict[int, Finding]:
    """Truth index → the finding at its place, those with the right effect first."""
    matches: dict[int, Finding] = {}
    left = list(findings)
    for exact in (True, False):
        for i, effect in enumerate(truth):
            for finding in left:
                right = not exact or finding["effect"] == effect.effect
                if i not in matches and right and _same_place(effect, names, finding):
                    matches[i] = finding
                    left.remove(finding)
                    break
    return matches


def _same_place(truth: HiddenEffect, names: Machine, finding: Finding) -> bool:
    """True if a finding is at the place of the truth, or at one that is as right."""
    right = [(truth.kind, truth.name), *truth.accept]
    at = finding["at"]
    return names.place(at["kind"], at["name"]) in [names.place(*place) for place in right]


def _names(finding: Finding) -> list[str]:
    return [finding["effect"], *(c["effect"] for c in finding.get("confusable_with", []))]


def _mark_parameters(
    truth: HiddenEffect,
    finding: Finding,
    errors: dict[str, float],
    covered: dict[str, bool],
    off: dict[str, float],
) -> None:
    for name in PARAMETERS.get(truth.effect, ()):
        said = finding["parameters"].get(name)
        if said is None or name not in truth.parameters:
            continue
        key = f"{truth.effect}.{name}"
        right = np.atleast_1d(np.asarray(truth.parameters[name], dtype=float))
        value = np.atleast_1d(np.asarray(said["value"], dtype=float))
        if value.shape != right.shape:
            errors[key] = float("inf")
            continue
        ends, size = _ends(said.get("ci95"), value.size), float(np.linalg.norm(right))
        if key in FACES:
            normal = np.asarray(truth.parameters["normal"], dtype=float)
            value, right, ends = _along(normal, value, right, ends)
        error = value - right
        if name in ANGLES:
            error = (error + np.pi) % (2 * np.pi) - np.pi
            errors[key] = float(np.abs(error).max())
        else:
            errors[key] = float(np.linalg.norm(error)) / max(size, 1e-12)
        if ends is not None and name != "side":
            # an angle is compared near the said value, wherever the turn was cut
            near = value - error
            covered[key] = bool(((ends[:, 0] <= near) & (near <= ends[:, 1])).all())
            for i, distance in enumerate(_distances(value, near, ends)):
                off[key if value.size == 1 else f"{key}[{i}]"] = distance


def _along(
    normal: Float[np.ndarray, " 3"],
    value: Float[np.ndarray, " 3"],
    right: Float[np.ndarray, " 3"],
    ends: Float[np.ndarray, "3 2"] | None,
) -> tuple[Float[np.ndarray, " 1"], Float[np.ndarray, " 1"], Float[np.ndarray, "1 2"] | None]:
    """Value, truth and ends along a face's normal: only the distance of the face counts."""
    along = np.array([normal @ value]), np.array([normal @ right])
    if ends is None:
        return *along, None
    # as if the components erred independently
    half = [np.linalg.norm(normal * (ends[:, k] - value)) for k in (0, 1)]
    return *along, np.array([[along[0][0] - half[0], along[0][0] + half[1]]])


def _ends(interval: object, size: int) -> Float[np.ndarray, "element 2"] | None:
    """Lower and upper ends of a parameter's intervals; None where none was given.

    A vector's may be given as (lower ends, upper ends), or as one pair for each element.
    """
    if interval is None:
        return None
    ends = np.asarray(interval, dtype=float)
    ends = ends[None] if ends.shape == (2,) and size == 1 else ends
    ends = ends.T if ends.shape != (size, 2) else ends
    return ends if ends.shape == (size, 2) else None


def _distances(
    value: Float[np.ndarray, " element"],
    right: Float[np.ndarray, " element"],
    ends: Float[np.ndarray, "element 2"],
) -> list[float]:
    """Truth minus estimate, in standard deviations by the interval's end on the truth's side."""
    above = right >= value
    half = np.where(above, ends[:, 1] - value, value - ends[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (right - value) / half * _END
    return [float(d) for d in np.where(right == value, 0.0, distance)]


def _after(diagnosis: Mapping[str, Any]) -> float:
    holdout = (diagnosis.get("fit") or {}).get("holdout") or {}
    after, floor = holdout.get("after_rmse"), holdout.get("noise_floor_rmse")
    return float(after) / float(floor) if after is not None and floor else float("nan")
