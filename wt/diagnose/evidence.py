"""Evidence beside the findings: replays to draw, and all else that was reported."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

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


Side = Literal["drive", "behind", "both", "measurement", "neither"]
"""Side of a measured force on which physics is missing: in the drive, that is before
the measurement (or the recorded position is not the one that the drive works with); behind it, in
joint or bodies; in both; in the measurement itself, which then agrees with nothing; in
neither."""


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
        side: of the measurement on which something is missing.
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
    """Root mean square error of a sensor's readings in replays of held-out recordings.

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
    """Reports of the robot besides its joints' motion.

    Attributes:
        forces: measured actuator forces.
        sensors: further sensors, and the forces again, in replays.
        notes: one sentence on each force that tells on which side something is missing, and on
            sensors that were not compared.
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
        after: of the translated one, which no translation of this model recovers.
    """

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Distance:
    """Distance of one recording's features from those that a translation expects.

    Attributes:
        name: of the recording.
        t: beginnings of control steps [s].
        size: in units of the usual distance.
    """

    name: str
    t: Float[np.ndarray, " step"]
    size: Float[np.ndarray, " step"]


@dataclass(frozen=True, eq=False)
class Translated:
    """Evidence of a trained translation; :mod:`wt.diagnose.observed.translation`.

    Attributes:
        name: of the translation.
        channels: errors before and after translation.
        distances: one a recording.
        events: intervals of the fitted recordings in which something hidden acted.
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
    """One recording and its replays, for pictures.

    Attributes:
        name: the recording's file name.
        role: fitted or held out.
        t: time [s].
        recorded: measured positions, NaN where missing [rad or m].
        before: positions replayed on the model as given.
        after: positions replayed on the patched model.
        velocity: smoothed velocities [rad/s or m/s].
        force_before: generalised force that the given model lacks and no contact may have supplied
            [N·m].
        force_after: force that the patched model still lacks.
        command: commands by actuator name.
    """

    name: str
    role: Role
    t: Float[np.ndarray, " sample"]
    recorded: Float[np.ndarray, "sample joint"]
    before: Float[np.ndarray, "sample joint"]
    after: Float[np.ndarray, "sample joint"]
    velocity: Float[np.ndarray, "sample joint"]
    force_before: Float[np.ndarray, "sample joint"]
    force_after: Float[np.ndarray, "sample joint"]
    command: Mapping[str, Float[np.ndarray, " sample"]]
