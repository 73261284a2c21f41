"""The answer of a case: its hidden effects, as sealed and as others may write it.

The format is JSON; ``docs/prove.md`` explains it. Only ``truth`` is required.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wt.errors import DataError
from wt.prove.cases import Case, HiddenEffect

KINDS = {0: "null", 1: "single", 2: "pair", 3: "triple"}
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Answer:
    """The hidden effects of a case, with what marking needs to know of it.

    Attributes:
        name: name of the case once it is open.
        kind: null, single, pair, triple, outsider (an effect outside every list), real (a
            machine of which nobody knows the truth; only the held-out fit is scored) or fleet
            (many machines; their levels are scored).
        truth: the hidden effects.
        visibility: for each of them the rms change it makes in the recordings over their noise;
            NaN where that is not known.
        excused: (effect, kind, name) that may be claimed though it does not count as hidden.
        rig: kind of machine.
        decoy: feature of a null that tempts to a false claim.
        level: size in a word.
        noise_rms: joint → rms noise of recorded positions [rad], where it is known.
        published_rmse: of a real machine the held-out error of what its laboratory fitted [rad or
            m]; NaN where there is none.
        known: what others have established about it.
        fleet: of a fleet the level of each quantity that differs, and what changed when.
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
    published_rmse: float = math.nan
    known: str = ""
    fleet: Mapping[str, Any] = field(default_factory=dict)

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
                effect_to_json(effect, None if math.isnan(visibility) else visibility)
                for effect, visibility in zip(self.truth, self.visibility, strict=True)
            ],
            "excused": [
                {"effect": effect, "at": {"kind": kind, "name": name}}
                for effect, kind, name in self.excused
            ],
            "noise_rms": dict(self.noise_rms),
            "published_rmse": None if math.isnan(self.published_rmse) else self.published_rmse,
            "known": self.known,
            **({"fleet": dict(self.fleet)} if self.fleet else {}),
        }


def of_case(case: Case, visibility: Sequence[float], noise_rms: Mapping[str, float]) -> Answer:
    """The answer of one of our own cases."""
    return Answer(
        case.name, case.kind, case.truth, tuple(visibility), case.excused, case.rig, case.decoy,
        case.level, dict(noise_rms),
    )  # fmt: skip


def from_json(data: object, name: str) -> Answer:
    """An answer, checked.

    Args:
        data: the JSON.
        name: of the case, for messages and where the answer has none.

    Raises:
        DataError: something is missing or of another type.
    """
    try:
        return _read(data, name)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(
            f"the answer of case '{name}' cannot be read: {what}; it needs 'truth', a list of "
            "{effect, at: {kind, name}, parameters} that is empty where nothing is hidden"
        ) from error


def _read(data: Any, name: str) -> Answer:  # noqa: ANN401 – JSON of others
    truth = tuple(effect_from_json(effect) for effect in data["truth"])
    if len(truth) > max(KINDS):
        raise ValueError(f"{len(truth)} effects are hidden, and at most {max(KINDS)} are marked")
    outside = any(effect.effect == UNKNOWN for effect in truth)
    visibility = [effect.get("visibility") for effect in data["truth"]]
    return Answer(
        name=str(data.get("name") or name),
        kind=str(data.get("kind") or ("outsider" if outside else KINDS[len(truth)])),
        truth=truth,
        visibility=tuple(or_nan(v) for v in visibility),
        excused=tuple(
            (str(entry["effect"]), *_place(entry["at"])) for entry in data.get("excused") or ()
        ),
        rig=str(data.get("rig") or ""),
        decoy=str(data.get("decoy") or ""),
        level=str(data.get("level") or ""),
        noise_rms={str(k): float(v) for k, v in (data.get("noise_rms") or {}).items()},
        published_rmse=or_nan(data.get("published_rmse")),
        known=str(data.get("known") or ""),
        fleet=dict(data.get("fleet") or {}),
    )


def effect_to_json(effect: HiddenEffect, visibility: float | None) -> dict[str, Any]:
    """A hidden effect as in an answer, with the rms change it makes over the noise."""
    return {
        "effect": effect.effect,
        "at": {"kind": effect.kind, "name": effect.name},
        "parameters": effect.parameters,
        "law": effect.law,
        "also_at": [{"kind": kind, "name": name} for kind, name in effect.accept],
        "visibility": visibility,
    }


def effect_from_json(data: Mapping[str, Any]) -> HiddenEffect:
    """A hidden effect of an answer."""
    kind, name = _place(data["at"])
    effect = str(data["effect"])
    return HiddenEffect(
        effect=effect,
        kind=kind,
        name=name,
        parameters=dict(data.get("parameters") or {}),
        law=str(data.get("law") or effect),
        accept=tuple(_place(place) for place in data.get("also_at") or ()),
    )


def _place(data: Mapping[str, Any]) -> tuple[str, str]:
    return str(data["kind"]), str(data["name"])


def or_nan(value: float | None) -> float:
    """A number of an answer or a result; NaN for None."""
    return math.nan if value is None else float(value)
