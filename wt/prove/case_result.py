"""The result of one case: hidden effects, each contender's claims, and the marks for them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wt.prove.answer import effect_from_json, effect_to_json, or_nan
from wt.prove.case import HiddenEffect
from wt.prove.fleet_marks import FleetMarks
from wt.prove.score import CaseScore, Finding


@dataclass(frozen=True)
class ContenderResult:
    """The result of one contender on one case.

    Attributes:
        seconds: wall-clock time of its diagnosis [s].
        error: one line; "" if a diagnosis was written.
        findings: its claims, each with ``effect``, ``at`` and ``parameters`` if it has any.
        marks: the claims compared with the hidden effects.
        experiments: how many it asked for; None where none could be.
        reach: how far a joint went in them, over its range; 0 without any.
        fleet: marks of a fleet's passport; None for single machines.
    """

    seconds: float
    error: str
    findings: tuple[Finding, ...]
    marks: CaseScore
    experiments: int | None = None
    reach: float = 0.0
    fleet: FleetMarks | None = None

    @property
    def false_alarm(self) -> bool:
        """True if it failed on a null: by a claim, or by an error, which is no silence."""
        return self.marks.false_claims > 0 or bool(self.error)

    def to_json(self) -> dict[str, Any]:
        """As in ``results.json``, but for numbers that are not finite."""
        asked = {"experiments": self.experiments, "reach": self.reach}
        return {
            "seconds": self.seconds,
            "error": self.error,
            "findings": [dict(finding) for finding in self.findings],
            "marks": self.marks.to_json(),
            **({} if self.experiments is None else asked),
            **({} if self.fleet is None else {"fleet": self.fleet.to_json()}),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ContenderResult:
        """Read one entry of ``results.json``."""
        marks = CaseScore.from_json(data["marks"])
        fleet = data.get("fleet")
        return cls(
            float(data["seconds"]),
            data["error"],
            tuple(data["findings"]),
            marks,
            data.get("experiments"),
            float(data.get("reach", 0.0)),
            None if fleet is None else FleetMarks.from_json(fleet),
        )


@dataclass(frozen=True)
class CaseResult:
    """The result of one case.

    Attributes:
        id: name while it was sealed, and of its folder.
        name: name in its set.
        kind: null, single, pair, triple, outsider, real or fleet.
        rig: the kind of machine.
        decoy: feature of a null that tempts to a false claim.
        level: size of the hidden effects in a word.
        truth: the hidden effects.
        visibility: for each of them the rms change it makes in the recordings over their noise;
            None where that is not known.
        noise_rms: rms noise of recorded positions over all joints [rad]; None where not known.
        published_rmse: error of what a real machine's laboratory fitted, likewise; NaN if nothing.
        known: what others have established about a real machine.
        before_rmse: error of the given model on held-out recordings [rad or m].
        contenders: contender → its result; ``said`` in JSON.
        after_rmse: contender → error of its patched model on held-out recordings [rad or m].
    """

    id: str
    name: str
    kind: str
    rig: str
    decoy: str
    level: str
    truth: tuple[HiddenEffect, ...]
    visibility: tuple[float | None, ...]
    noise_rms: float | None
    published_rmse: float
    known: str
    before_rmse: float
    contenders: Mapping[str, ContenderResult]
    after_rmse: Mapping[str, float]

    def marks(self, contender: str) -> CaseScore:
        """Marks of a contender."""
        return self.contenders[contender].marks

    def to_json(self) -> dict[str, Any]:
        """As in ``results.json``: None for numbers that are not finite."""
        effects = zip(self.truth, self.visibility, strict=True)
        data: dict[str, Any] = finite(
            {
                "id": self.id,
                "name": self.name,
                "kind": self.kind,
                "rig": self.rig,
                "decoy": self.decoy,
                "level": self.level,
                "truth": [effect_to_json(effect, visibility) for effect, visibility in effects],
                "noise_rms": self.noise_rms,
                "published_rmse": self.published_rmse,
                "known": self.known,
                "before_rmse": self.before_rmse,
                "said": {who: result.to_json() for who, result in self.contenders.items()},
                "after_rmse": dict(self.after_rmse),
            }
        )
        return data

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CaseResult:
        """Read one case of ``results.json``."""
        entries: Mapping[str, Mapping[str, Any]] = data["said"]
        return cls(
            **{key: data[key] for key in ("id", "name", "kind", "rig", "decoy", "level")},
            truth=tuple(effect_from_json(effect) for effect in data["truth"]),
            visibility=tuple(effect["visibility"] for effect in data["truth"]),
            noise_rms=data["noise_rms"],
            published_rmse=or_nan(data["published_rmse"]),
            known=data["known"],
            before_rmse=or_nan(data["before_rmse"]),
            contenders={who: ContenderResult.from_json(entry) for who, entry in entries.items()},
            after_rmse={who: or_nan(rmse) for who, rmse in data["after_rmse"].items()},
        )


def finite(value: Any) -> Any:  # noqa: ANN401 – any JSON
    """JSON with None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
