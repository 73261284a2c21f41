"""What a diagnosis says: frozen, and written as the public ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from wt.diagnose.evidence import Considered, Measured, Proof, Role, Trace, Translated
from wt.diagnose.evidence import Error as Error
from wt.diagnose.evidence import Interval as Interval
from wt.types import Location

Verdict = Literal["no_mismatch", "explained", "partly_explained", "unexplained"]


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval; vectors have tuples throughout.

    Attributes:
        value: the estimate.
        unit: its unit.
        ci95: lower and upper end.
        warning: "" or why it should not be trusted (at a bound, not identifiable).
    """

    value: float | tuple[float, ...]
    unit: str
    ci95: tuple[float | tuple[float, ...], float | tuple[float, ...]]
    warning: str = ""

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        said = {"value": self.value, "unit": self.unit, "ci95": list(self.ci95)}
        return said | ({"warning": self.warning} if self.warning else {})


@dataclass(frozen=True)
class Confusable:
    """Another effect that these recordings cannot tell from a finding, and what would."""

    effect: str
    at: Location
    separating_experiment: str


@dataclass(frozen=True)
class Finding:
    """One piece of physics that the model leaves out.

    Attributes:
        effect: its id, or ``"unknown"``.
        at: where.
        parameters: estimates by name; empty for unknown effects.
        statement: one plain sentence.
        holdout_gain: share of the held-out squared error that it removes.
        p_value: of that gain being chance, over the whole search.
        confusable_with: what could not be told apart.
        depends_on: columns an unknown effect depends on.
        formula: an unknown effect's force in those columns.
        reference: literature of the law.
    """

    effect: str
    at: Location
    parameters: Mapping[str, Estimate]
    statement: str
    holdout_gain: float
    p_value: float
    confusable_with: tuple[Confusable, ...] = ()
    depends_on: tuple[str, ...] = ()
    formula: str | None = None
    reference: str = ""

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "effect": self.effect,
            "at": _place(self.at),
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "statement": self.statement,
            "evidence": {"holdout_gain": self.holdout_gain, "p_value": self.p_value},
            "confusable_with": [
                {
                    "effect": c.effect,
                    "at": _place(c.at),
                    "separating_experiment": c.separating_experiment,
                }
                for c in self.confusable_with
            ],
            "depends_on": list(self.depends_on),
            "formula": self.formula,
        }


@dataclass(frozen=True)
class Located:
    """A place where simulation and recording part.

    Attributes:
        at: the place.
        share: of the mismatch, 0…1.
        intervals: when, recording after recording and in order of time.
        condition: under which condition, in words; "" if always.
    """

    at: Location
    share: float
    intervals: tuple[Interval, ...] = ()
    condition: str = ""

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``, whose intervals are those of the first recording that has any.

        They come without its name there, so those of other recordings would be mistaken for it.
        """
        first = self.intervals[0].recording if self.intervals else ""
        return {
            "at": _place(self.at),
            "share": self.share,
            "intervals_s": [[i.start, i.end] for i in self.intervals if i.recording == first],
            "condition": self.condition,
        }


@dataclass(frozen=True)
class Used:
    """A recording that was used."""

    path: str
    role: Role
    seconds: float
    rate_hz: float

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "path": self.path,
            "role": self.role,
            "seconds": self.seconds,
            "rate_hz": self.rate_hz,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis:
    """Everything a diagnosis found, with what a report needs to show it.

    Attributes:
        model_path: the MJCF that was given.
        model_sha256: hash of its bytes.
        joints: joint names, the columns of the traces.
        recordings: what was used, and for what.
        verdict: in one word.
        locations: where, ranked.
        findings: what is missing, most important first; empty if nothing is.
        proof: the held-out fit.
        given_xml: the MJCF as given.
        patched_xml: the MJCF with the findings.
        considered: the search, best first.
        traces: recordings and replays.
        measured: what measured forces and further sensors say.
        translated: what a trained translation says of the recordings, if one was given.
        suggestions: what to record next, in words.
        notes: warnings and remarks, e.g. a refined time step.
        residual_onnx: learned remainder as ONNX bytes, if one was needed.
        seconds: how long it took [s].
        unit: of positions.
    """

    model_path: str
    model_sha256: str
    joints: tuple[str, ...]
    recordings: tuple[Used, ...]
    verdict: Verdict
    locations: tuple[Located, ...]
    findings: tuple[Finding, ...]
    proof: Proof
    given_xml: str
    patched_xml: str
    considered: tuple[Considered, ...] = ()
    traces: tuple[Trace, ...] = ()
    measured: Measured = field(default_factory=Measured)
    translated: Translated | None = None
    suggestions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    residual_onnx: bytes | None = None
    seconds: float = 0.0
    unit: str = "rad"

    def to_json(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``."""
        h = self.proof.holdout
        return {
            "schema": 1,
            "model": {"path": self.model_path, "sha256": self.model_sha256},
            "recordings": [r.to_json() for r in self.recordings],
            "verdict": self.verdict,
            "locations": [place.to_json() for place in self.locations],
            "findings": [f.to_json() for f in self.findings],
            "fit": {
                "holdout": {
                    "before_rmse": h.before,
                    "after_rmse": h.after,
                    "noise_floor_rmse": h.noise_floor,
                    "ratio": h.ratio,
                    "ratio_ci95": list(h.ratio_ci95),
                    "unit": self.unit,
                }
            },
            "artifacts": {
                "model": "model.xml",
                "report": "report.html",
                "rerun": "diagnosis.rrd",
                "residual": "residual.onnx" if self.residual_onnx else None,
            },
        }

    def write(self, out: str | Path) -> None:
        """Write the report, the patched model and the rest into a folder."""
        from wt.diagnose.write import write

        write(self, Path(out))

    def show(self) -> None:
        """Print the findings, on a terminal or in a notebook."""
        from rich.console import Console

        from wt.diagnose.words import print_summary

        print_summary(self, Console())

    def __repr__(self) -> str:
        """The findings in plain sentences."""
        from wt.diagnose.words import fit, sentences

        return "\n".join([f"Diagnosis: {self.verdict}", *sentences(self), fit(self)])

    def _repr_html_(self) -> str:
        """A short summary, which a notebook shows by itself."""
        from wt.diagnose.words import to_html

        return to_html(self)


def _place(at: Location) -> dict[str, str]:
    return {"kind": at.kind, "name": at.name}
