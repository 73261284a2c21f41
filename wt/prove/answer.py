"""The answer of a case: what is hidden, as it is sealed, and as others may write it.

The format is JSON; ``docs/prove.md`` explains it. Only ``truth`` is required.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wt.errors import DataError
from wt.prove.cases import Case, HiddenEffect

KINDS = {0: "null", 1: "single", 2: "pair", 3: "triple"}
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Answer:
    """What is hidden in a case.

    Attributes:
        name: what the case is called once it is open.
        kind: null, single, pair, triple, outsider (an effect outside every list) or real (a
            machine of which nobody knows the truth; only the held-out fit is scored).
        truth: the hidden effects.
        visibility: for each of them the rms change it makes in the recordings over their noise;
            NaN where that is not known.
        excused: (effect, kind, name) that may be said though it is not looked for.
        rig: kind of machine.
        decoy: what a null tempts with.
        level: size in a word.
        noise_rms: joint → rms noise of recorded positions [rad], where it is known.
    """

    name: str
    kind: str
    truth: tuple[HiddenEffect, ...]
    visibility: tuple[float, ...]
    excused: tuple[tuple[str, str, str], ...] = ()
    rig: str = ""
    decoy: str = ""
    level: str = ""
    noise_rms: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """As it is sealed."""
        return {
            "schema": 1,
            "name": self.name,
            "kind": self.kind,
            "rig": self.rig,
            "decoy": self.decoy,
            "level": self.level,
            "truth": [
                {
                    "effect": truth.effect,
                    "at": {"kind": truth.kind, "name": truth.name},
                    "parameters": truth.parameters,
                    "law": truth.law,
                    "also_at": [{"kind": kind, "name": name} for kind, name in truth.accept],
                    "visibility": None if seen != seen else seen,
                }
                for truth, seen in zip(self.truth, self.visibility, strict=True)
            ],
            "excused": [
                {"effect": effect, "at": {"kind": kind, "name": name}}
                for effect, kind, name in self.excused
            ],
            "noise_rms": dict(self.noise_rms),
        }


def of_case(case: Case, visibility: Sequence[float], noise_rms: Mapping[str, float]) -> Answer:
    """The answer of one of our own cases."""
    return Answer(
        case.name, case.kind, case.truth, tuple(visibility), case.excused, case.rig, case.decoy,
        case.level, dict(noise_rms),
    )  # fmt: skip


def from_json(said: object, name: str) -> Answer:
    """An answer, checked.

    Args:
        said: the JSON.
        name: of the case, for messages and where the answer has none.

    Raises:
        DataError: something is missing or of another type.
    """
    try:
        return _read(said, name)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(
            f"the answer of case '{name}' cannot be read: {what}; it needs 'truth', a list of "
            "{effect, at: {kind, name}, parameters} that is empty where nothing is hidden"
        ) from error


def _read(said: Any, name: str) -> Answer:  # noqa: ANN401 – JSON of others
    truth = tuple(_truth(one) for one in said["truth"])
    if len(truth) > max(KINDS):
        raise ValueError(f"{len(truth)} effects are hidden, and at most {max(KINDS)} are marked")
    outside = any(one.effect == UNKNOWN for one in truth)
    seen = [one.get("visibility") for one in said["truth"]]
    return Answer(
        name=str(said.get("name") or name),
        kind=str(said.get("kind") or ("outsider" if outside else KINDS[len(truth)])),
        truth=truth,
        visibility=tuple(float("nan") if v is None else float(v) for v in seen),
        excused=tuple(
            (str(one["effect"]), *_place(one["at"])) for one in said.get("excused") or ()
        ),
        rig=str(said.get("rig") or ""),
        decoy=str(said.get("decoy") or ""),
        level=str(said.get("level") or ""),
        noise_rms={str(k): float(v) for k, v in (said.get("noise_rms") or {}).items()},
    )


def _truth(said: Mapping[str, Any]) -> HiddenEffect:
    kind, name = _place(said["at"])
    effect = str(said["effect"])
    return HiddenEffect(
        effect=effect,
        kind=kind,
        name=name,
        parameters=dict(said.get("parameters") or {}),
        law=str(said.get("law") or effect),
        accept=tuple(_place(place) for place in said.get("also_at") or ()),
    )


def _place(said: Mapping[str, Any]) -> tuple[str, str]:
    return str(said["kind"]), str(said["name"])
