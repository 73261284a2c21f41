"""Diagnosis as data: findings, places, proof, and the replays to draw.

Frozen, with the public ``diagnosis.json`` as :meth:`Diagnosis.to_json`. Nothing here writes or
draws; :mod:`wt.diagnose.report` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from wt.types import Location

Array = np.ndarray

Role = Literal["fit", "holdout"]


@dataclass(frozen=True)
class Interval:
    """A stretch of time of one recording.

    Attributes:
        recording: its name.
        start: since the recording's start [s].
        end: likewise [s].
    """

    recording: str
    start: float
    end: float


@dataclass(frozen=True)
class Error:
    """Root mean square errors of replays against recordings [rad or m].

    Attributes:
        before: of the model as it was given.
        after: of the patched model.
        noise_floor: what measurement noise alone would give.
        ratio: after / before.
        ratio_ci95: its 95 % interval, from blocks longer than the errors' memory.
    """

    before: float
    after: float
    noise_floor: float
    ratio: float
    ratio_ci95: tuple[float, float]


@dataclass(frozen=True)
class Proof:
    """The fit on recordings, or parts of them, that nothing was fitted to.

    Attributes:
        holdout: over all joints, open loop.
        joints: per joint, open loop.
        horizons: seconds ahead → (before, after) RMSE of replays restarted that often.
        one_step: RMSE one sample ahead, before and after.
        left_over: tests on the patched model's residual, one sentence each; empty if clean.
        split: how the held-out data was chosen, in words.
    """

    holdout: Error
    joints: Mapping[str, Error]
    horizons: Mapping[float, tuple[float, float]]
    one_step: tuple[float, float]
    left_over: tuple[str, ...] = ()
    split: str = ""


@dataclass(frozen=True)
class Considered:
    """One hypothesis of the search, for the report.

    Attributes:
        effect: its id.
        at: where.
        gain: log-likelihood gained over the model without it [nats].
        stage: ``"screened"`` (force residual only) or ``"replayed"``.
        verdict: in words: "accepted", "beaten by …", "gains too little".
    """

    effect: str
    at: Location
    gain: float
    stage: Literal["screened", "replayed"]
    verdict: str


Side = Literal["drive", "behind", "both", "measurement", "neither"]
"""Where a measured force says that physics is missing: in the drive, that is before the measurement
(or the recorded position is not the one that the drive works with); behind it, in joint or bodies;
in both; in the measurement itself, which then agrees with nothing; in neither."""


@dataclass(frozen=True)
class MeasuredForce:
    """A measured actuator force beside the model's and beside what the motion demands.

    Root mean squares of the joint's force over the fitted recordings [N·m or N].

    Attributes:
        actuator: its name.
        joint: the joint that it drives.
        moves: the bodies that this joint moves.
        off_law: measured force less the model's law at the recorded command and motion.
        off_motion: force that the motion demands of the model, less the measured one.
        lacking: force that the motion demands, less the model's law: the sum of the two.
        unit: of these.
        side: where something is missing.
    """

    actuator: str
    joint: str
    moves: tuple[str, ...]
    off_law: float
    off_motion: float
    lacking: float
    unit: str
    side: Side


@dataclass(frozen=True)
class SensorError:
    """Root mean square error of what replays of held-out recordings say that a sensor reports.

    Attributes:
        name: of the MJCF sensor, or ``force/<actuator>`` of a measured actuator force.
        unit: of the errors.
        before: of the model as it was given.
        after: of the patched model; None where the replay does not tell.
    """

    name: str
    unit: str
    before: float
    after: float | None


@dataclass(frozen=True)
class Measured:
    """What the robot reports besides its joints' motion.

    Attributes:
        forces: measured actuator forces.
        sensors: further sensors, and the forces again, in replays.
        notes: one sentence on each force that says where something is missing, and on sensors
            that were not compared.
    """

    forces: tuple[MeasuredForce, ...] = ()
    sensors: tuple[SensorError, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ChannelLeft:
    """Root mean square error one control step ahead, from the recorded state.

    Attributes:
        name: channel of the translation's state.
        unit: of the errors.
        before: of the model's own answer.
        after: of the translated one: what no translation of this model recovers.
    """

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Distance:
    """How far features of one recording are from those that a translation expects.

    Attributes:
        name: of the recording.
        t: beginnings of control steps, (K,) [s].
        size: in units of the usual distance, (K,).
    """

    name: str
    t: Array
    size: Array


@dataclass(frozen=True, eq=False)
class Translated:
    """What a trained translation says of the recordings; :mod:`wt.diagnose.observed.translation`.

    Attributes:
        name: of the translation.
        channels: errors before and after translation.
        distances: one a recording.
        events: when something hidden acted in the fitted recordings.
    """

    name: str
    channels: tuple[ChannelLeft, ...]
    distances: tuple[Distance, ...]
    events: tuple[Interval, ...]

    @property
    def left(self) -> float:
        """Share of the squared error that translation leaves, mean over channels."""
        return float(np.mean([(c.after / max(c.before, 1e-30)) ** 2 for c in self.channels]))


@dataclass(frozen=True, eq=False)
class Trace:
    """One recording and its replays, for pictures. Arrays are (T, n_joints) unless said.

    Attributes:
        name: the recording's file name.
        role: whether it was fitted or held out.
        t: time, (T,) [s].
        recorded: measured positions, NaN where missing [rad or m].
        before: positions replayed on the model as given.
        after: positions replayed on the patched model.
        velocity: smoothed velocities.
        force_before: generalised force that the given model lacks [N·m].
        force_after: what the patched model still lacks.
        command: commands by actuator name, (T,) each.
    """

    name: str
    role: Role
    t: Array
    recorded: Array
    before: Array
    after: Array
    velocity: Array
    force_before: Array
    force_after: Array
    command: Mapping[str, Array]


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


def _place(at: Location) -> dict[str, str]:
    return {"kind": at.kind, "name": at.name}
