"""Diagnosis as data: findings, places, proof, and the replays to draw.

Frozen, with the public ``diagnosis.json`` as :meth:`Diagnosis.to_json`. Nothing here writes or
draws; :mod:`wt.diagnose.report` does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from wt.check.finding import AuditFinding
from wt.diagnose.evidence import Interval, Measured, Role, Trace, Translated
from wt.types import Location


@dataclass(frozen=True)
class Error:
    """Root mean square errors of replays against recordings [rad or m].

    Attributes:
        before: of the model as it was given.
        after: of the patched model.
        noise_floor: error that measurement noise alone would give.
        ratio: after / before.
        ratio_ci95: its 95 % interval, from blocks longer than the errors' memory.
    """

    before: float
    after: float
    noise_floor: float
    ratio: float
    ratio_ci95: tuple[float, float]

    def to_json(self, unit: str) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "before_rmse": self.before,
            "after_rmse": self.after,
            "noise_floor_rmse": self.noise_floor,
            "ratio": self.ratio,
            "ratio_ci95": list(self.ratio_ci95),
            "unit": unit,
        }


@dataclass(frozen=True)
class Proof:
    """The fit on recordings, or parts of them, that nothing was fitted to.

    Attributes:
        holdout: over all joints, open loop.
        joints: per joint, open loop.
        horizons: unit → seconds ahead → (before, after) RMSE of replays restarted that often,
            over the joints whose positions have that unit.
        left_over: tests on the patched model's residual, one sentence each; empty if clean.
        split: choice of the held-out data, in words.
        model_only: as ``holdout``, of ``model.xml`` alone; None if that is all there is.
    """

    holdout: Error
    joints: Mapping[str, Error]
    horizons: Mapping[str, Mapping[float, tuple[float, float]]]
    left_over: tuple[str, ...] = ()
    split: str = ""
    model_only: Error | None = None


Stage = Literal[
    "screened",
    "replayed",
    "joined",
    "pruned",
    "reconsidered",
    "alternative",
    "simplified",
    "contradicted",
    "certainty",
    "holdout",
    "event",
    "doubted",
    "unknown",
    "calibrated",
]
"""Stages of a diagnosis that decide, with the statistic that each compares:

- ``screened``: gain on the force residual [nats], for what was not worth a replay;
- ``replayed``: gain in replays beyond the price of its parameters [nats];
- ``joined``: the same, for what joined the search;
- ``pruned``: what is lost without it [nats];
- ``reconsidered``: lead of what took its place beside the others [nats];
- ``alternative``: lead of a law that looks alike, on all recordings [nats];
- ``simplified``: parameters of the law, against those of the simpler one that says as much;
- ``contradicted``: 1, by a recording that shows it to be otherwise;
- ``certainty``: distance from being nothing [widths of the 95 % interval];
- ``holdout``: p-value of its gain on data that it was not fitted to;
- ``event``: probability that moments of usual errors hold it; where one of several is given up,
  the lead of replays with it [nats];
- ``doubted``: mean square that a nonparametric force leaves, over what the name leaves;
- ``unknown``: p-value of a learned law;
- ``calibrated``: p-value of all corrections within tolerance together.
"""


@dataclass(frozen=True)
class Decision:
    """One decision on one effect at one place.

    Attributes:
        effect: its id.
        at: where.
        stage: of the diagnosis, that decided.
        kept: true where it stayed.
        statistic: figure that decided, in the unit of its stage; None if it is not finite.
        threshold: figure that it was compared with.
        reason: one clause for people.
    """

    effect: str
    at: Location
    stage: Stage
    kept: bool
    statistic: float | None
    threshold: float
    reason: str

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> Decision:
        """Read :meth:`to_json`."""
        return cls(**{**entry, "at": Location(entry["at"]["kind"], entry["at"]["name"])})

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "effect": self.effect,
            "at": _place(self.at),
            "stage": self.stage,
            "kept": self.kept,
            "statistic": self.statistic,
            "threshold": self.threshold,
            "reason": self.reason,
        }


Verdict = Literal["no_mismatch", "explained", "partly_explained", "unexplained"]


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval; vectors have tuples throughout.

    Attributes:
        value: the estimate.
        unit: its unit.
        ci95: lower and upper end.
        warning: "" or why it should not be trusted (at a bound, not identifiable).
        unshown: axes of a vector that the recordings cannot show; its interval is all that is
            admissible there, and the value is where it was left.
    """

    value: float | tuple[float, ...]
    unit: str
    ci95: tuple[float | tuple[float, ...], float | tuple[float, ...]]
    warning: str = ""
    unshown: tuple[str, ...] = ()

    @property
    def note(self) -> str:
        """The warning, and which axes are not shown; "" if there is neither."""
        axes = ", ".join(self.unshown)
        left = f"these recordings cannot show {axes}, which is not fitted" if axes else ""
        return "; ".join(part for part in (self.warning, left) if part)

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        entry = {"value": self.value, "unit": self.unit, "ci95": list(self.ci95)}
        return entry | ({"warning": self.note} if self.note else {})


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
        confusable_with: effects that could not be told apart from it.
        depends_on: columns an unknown effect depends on.
        formula: an unknown effect's force in those columns.
        formula_gain: share of the held-out squared error that the formula as printed removes.
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
    formula_gain: float | None = None
    reference: str = ""

    @property
    def lawless(self) -> bool:
        """Whether something unknown acts of which no law is proven."""
        return self.effect == "unknown" and not self.holdout_gain

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        printed = {} if self.formula_gain is None else {"formula_gain": self.formula_gain}
        return {
            "effect": self.effect,
            "at": _place(self.at),
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "statement": self.statement,
            "evidence": {"holdout_gain": self.holdout_gain, "p_value": self.p_value, **printed},
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
        """As in ``diagnosis.json``: ``intervals`` has those of every recording by its name.

        ``intervals_s`` has those of the first recording that has any.
        """
        names = list(dict.fromkeys(i.recording for i in self.intervals))
        each = {
            name: [[i.start, i.end] for i in self.intervals if i.recording == name]
            for name in names
        }
        return {
            "at": _place(self.at),
            "share": self.share,
            "intervals_s": each[names[0]] if names else [],
            "intervals": [{"recording": name, "intervals_s": each[name]} for name in names],
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
    """All that a diagnosis found, with the data of its report.

    Attributes:
        model_path: the MJCF that was given.
        model_sha256: hash of its bytes.
        joints: joint names, the columns of the traces.
        recordings: those that were used, and their roles.
        verdict: in one word.
        locations: places of the mismatch, ranked.
        findings: physics that is missing, most important first; empty if none is.
        proof: the held-out fit.
        given_xml: the MJCF as given.
        patched_xml: the MJCF with the findings.
        audit: what was wrong with the recordings or the model before any physics; the rest is of
            the corrected ones.
        decisions: all that was considered, and why it stayed or went, in order of time.
        traces: recordings and replays.
        measured: evidence of measured forces and further sensors.
        translated: evidence of a trained translation, if one was given.
        suggestions: experiments to record next, in words.
        notes: warnings and remarks, e.g. a refined time step.
        residual_onnx: learned remainder as ONNX bytes, if one was needed.
        physics_py: all of the findings that MJCF cannot say, as Python; None if it says it all.
        holdout_npz: starts of the held-out replays; see ``report/verify.py``.
        seconds: time that it took [s].
        units: of the joints' positions, "rad" or "m" each; empty if all are hinges.
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
    audit: tuple[AuditFinding, ...] = ()
    decisions: tuple[Decision, ...] = ()
    traces: tuple[Trace, ...] = ()
    measured: Measured = field(default_factory=Measured)
    translated: Translated | None = None
    suggestions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    residual_onnx: bytes | None = None
    physics_py: str | None = None
    holdout_npz: bytes | None = None
    seconds: float = 0.0
    units: tuple[str, ...] = ()

    def unit_of(self, joint: str) -> str:
        """Unit of a joint's position."""
        return self.units[self.joints.index(joint)] if self.units else "rad"

    @property
    def compared(self) -> Mapping[str, int]:
        """Units of the joints that were compared, and how many have each, the most common first."""
        units = [self.unit_of(j) for j in (self.proof.joints or self.joints)]
        return dict(Counter(sorted(units, reverse=True)).most_common())

    @property
    def unit(self) -> str:
        """Unit of errors over all joints; where hinges and slides mix, that of most of them.

        Such an error is of the bare figures, in SI: what the joints' own are, says each joint's.
        """
        return next(iter(self.compared), "rad")

    def to_json(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``."""
        h = self.proof.holdout
        alone = self.proof.model_only or h
        return {
            "schema": 1,
            "model": {"path": self.model_path, "sha256": self.model_sha256},
            "recordings": [r.to_json() for r in self.recordings],
            "verdict": self.verdict,
            "locations": [place.to_json() for place in self.locations],
            "findings": [f.to_json() for f in self.findings],
            "fit": {
                "holdout": {
                    **h.to_json(self.unit),
                    "joints": {j: e.to_json(self.unit_of(j)) for j, e in self.proof.joints.items()},
                    "model_only": {"after_rmse": alone.after, "ratio": alone.ratio},
                }
            },
            "audit": [f.to_json() for f in self.audit],
            "decisions": [d.to_json() for d in self.decisions],
            "artifacts": {
                "model": "model.xml",
                "report": "report.html",
                "rerun": "diagnosis.rrd",
                "physics": "physics.py" if self.physics_py else None,
                "residual": "residual.onnx" if self.residual_onnx else None,
                "holdout": "holdout.npz" if self.holdout_npz else None,
            },
        }


def _place(at: Location) -> dict[str, str]:
    return {"kind": at.kind, "name": at.name}
