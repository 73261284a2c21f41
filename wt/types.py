"""The frozen nouns that travel between stages; each checks itself when it is made.

Arrays are copied in and made read-only: what one stage was given, no other stage can change.
Units are SI and angles radians.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int, Shaped

from wt.errors import DataError, RecordingError

Domain = Literal["sim", "real"]
"""S ("sim", the source of translation) or R ("real", its target)."""

Kind = Literal["joint", "actuator", "body", "geom", "sensor", "world", "pair"]
"""Things that a location names: an element of the MJCF, the whole scene, or two acting together."""


@dataclass(frozen=True, order=True)
class Location:
    """A place in a model where physics can be missing.

    Attributes:
        kind: kind of the thing that is named.
        name: an MJCF name; ``"world"`` for the whole scene, ``"all"`` for every channel,
            ``"a+b"`` for a pair.
    """

    kind: Kind
    name: str

    def __str__(self) -> str:
        """As in messages, e.g. ``"joint j2"``; the world is its own name."""
        return self.name if self.kind == "world" else f"{self.kind} {self.name}"


def _frozen_array(value: Shaped[np.ndarray, "*shape"], dtype: type) -> Shaped[np.ndarray, "*shape"]:
    array: np.ndarray = np.array(value, dtype=dtype, order="C")
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class Channel:
    """One scalar of an observation, action or hidden variable.

    Attributes:
        name: e.g. ``"qpos/joint1"``; unique within its group.
        unit: e.g. ``"rad"``, ``"rad/s"``, ``"N"``.
    """

    name: str
    unit: str


@dataclass(frozen=True)
class TransitionSpec:
    """Layout of a transition (o, a, o′) and of the hidden variable h of one task.

    An observation starts with the ``n_state`` channels that dynamics decide (joint positions,
    velocities, …), followed by channels that are known without any prediction: the last action
    and, for some tasks, delayed copies of earlier samples. Errors are measured on the first
    ``n_state`` channels only, since the others are exact for every method.

    Attributes:
        task: name of the task, e.g. ``"r5_force"``.
        rate_hz: control rate [Hz]; one transition lasts 1 / rate_hz seconds.
        joints: joint names in the order of the position channels.
        observation: all channels of o.
        n_state: number of leading channels of o that are predicted.
        action: channels of a.
        hidden: channels of h; empty when nothing is hidden.
        pose: indices into o of the joint positions, in the order of ``joints``.
        integrated: (position, velocity) channels of which the velocity is, by definition, the
            difference of the last two positions times the rate. Then q′ = q + q̇′ / rate exactly,
            and only the velocity has to be predicted.
    """

    task: str
    rate_hz: float
    joints: tuple[str, ...]
    observation: tuple[Channel, ...]
    n_state: int
    action: tuple[Channel, ...]
    hidden: tuple[Channel, ...] = ()
    pose: tuple[int, ...] = ()
    integrated: tuple[tuple[int, int], ...] = ()

    @property
    def n_obs(self) -> int:
        """Number of observation channels."""
        return len(self.observation)

    @property
    def n_action(self) -> int:
        """Number of action channels."""
        return len(self.action)

    @property
    def state(self) -> tuple[Channel, ...]:
        """The predicted channels, the first ``n_state`` of the observation."""
        return self.observation[: self.n_state]


@dataclass(frozen=True)
class Transitions:
    """Transitions of one domain, one a row, ordered by episode and, inside it, by step.

    Kept as float32 and int32.

    Attributes:
        o: observation before the step.
        a: action in force during the step.
        s_next: state channels after the step.
        nominal: state channels after the step of the *simulator with nothing hidden*, reset to
            this transition's (o, a). For either domain it may be computed without knowing what is
            hidden.
        hidden: hidden variable in force during the step; NaN where unknown, as on a real robot.
            For probes and paired evaluation, never for training.
        episode: episode (or recording) that each transition belongs to.
        step: index of the transition inside its episode.
    """

    # as given: other precisions are converted, and numbers of rows that differ are a user's mistake
    o: Shaped[np.ndarray, "_ obs"]
    a: Shaped[np.ndarray, "_ action"]
    s_next: Shaped[np.ndarray, "_ state"]
    nominal: Shaped[np.ndarray, "_ state"]
    hidden: Shaped[np.ndarray, "_ hidden"]
    episode: Shaped[np.ndarray, " _"]
    step: Shaped[np.ndarray, " _"]

    def __post_init__(self) -> None:
        """Copy the arrays in, make them read-only and check that their lengths agree."""
        n = len(self.o)
        for f in dataclasses.fields(self):
            dtype = np.int32 if f.name in ("episode", "step") else np.float32
            array = _frozen_array(getattr(self, f.name), dtype)
            object.__setattr__(self, f.name, array)
            if len(array) != n:
                raise DataError(
                    f"transitions: '{f.name}' has {len(array)} rows and 'o' has {n}; "
                    "all fields need one row per transition"
                )
            if f.name != "hidden" and array.dtype == np.float32 and not np.isfinite(array).all():
                row = int(np.argwhere(~np.isfinite(array))[0, 0])
                raise DataError(
                    f"transitions: '{f.name}' is not finite at row {row}; "
                    "a world that exploded or a corrupt file: collect again"
                )

    def __len__(self) -> int:
        """Number of transitions."""
        return len(self.o)

    def select(self, rows: Int[np.ndarray, " selected"] | Bool[np.ndarray, " row"]) -> Transitions:
        """The transitions at some rows, in that order, or where a mask is true."""
        return Transitions(
            **{f.name: getattr(self, f.name)[rows] for f in dataclasses.fields(self)}
        )


@dataclass(frozen=True)
class Pairs:
    """Transitions of R, each with S's answer to the same (o, a) and the same hidden variable.

    Only evaluation and model selection may read them; they are never trained on.

    Attributes:
        real: R's transitions; history is available through episode and step.
        sim_next: S's state channels after the step.
    """

    real: Transitions
    sim_next: Shaped[np.ndarray, "_ state"]  # as given; a wrong shape is a user's mistake

    def __post_init__(self) -> None:
        """Copy ``sim_next`` in, make it read-only and check its shape."""
        object.__setattr__(self, "sim_next", _frozen_array(self.sim_next, np.float32))
        if self.sim_next.shape != self.real.s_next.shape:
            raise DataError(
                f"pairs: sim_next has shape {self.sim_next.shape}, "
                f"the real transitions {self.real.s_next.shape}"
            )

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.real)


@dataclass(frozen=True)
class Recording:
    """One recording of one robot: a table of float64 columns over time.

    The columns and their meaning are those of the public recording format: ``t`` [s],
    ``ctrl/<actuator>``, ``qpos/<joint>`` [rad or m], ``qvel/<joint>``, ``force/<actuator>``,
    ``sensor/<name>/<i>``. NaN is a missing sample. A machine without actuators has no commands.

    Attributes:
        t: time stamps, strictly increasing [s].
        columns: every other column by name.
        meta: free metadata: robot, source, licence, rate, notes.
    """

    # as given: lengths that differ are a user's mistake
    t: Shaped[np.ndarray, "*_"]
    columns: Mapping[str, Shaped[np.ndarray, "*_"]]
    meta: Mapping[str, object] = field(default_factory=dict)

    MIN_SECONDS = 2.0
    LARGEST = 1e60
    """No unit makes a measurement larger; squares of it are numbers."""

    def __post_init__(self) -> None:
        """Copy the columns in, make them read-only and check them against the format."""
        t = _frozen_array(self.t, np.float64)
        columns = {name: _frozen_array(c, np.float64) for name, c in self.columns.items()}
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "columns", columns)
        if t.ndim != 1 or len(t) < 2:
            raise RecordingError("column 't' needs at least two samples")
        if not np.isfinite(t).all() or (np.diff(t) <= 0).any():
            row = int(np.argmax(~((np.diff(t) > 0) & np.isfinite(t[1:])))) + 1
            raise RecordingError(
                f"column 't' does not increase at row {row} ({t[row - 1]} s, then {t[row]} s); "
                "sort or cut the recording there"
            )
        if t[-1] - t[0] < self.MIN_SECONDS:
            raise RecordingError(
                f"column 't' spans {t[-1] - t[0]:.3f} s; at least {self.MIN_SECONDS:g} s are needed"
            )
        for name, column in columns.items():
            if column.shape != t.shape:
                raise RecordingError(f"column '{name}' has {column.size} samples, 't' has {len(t)}")
            if (endless := np.abs(column) > self.LARGEST).any():
                row = int(np.argmax(endless))
                size = "infinite" if np.isinf(column[row]) else f"{column[row]:.3g}"
                raise RecordingError(
                    f"column '{name}' is {size} at row {row}; a missing sample is NaN"
                )
        if not any(name.startswith(("ctrl/", "qpos/")) for name in columns):
            raise RecordingError(
                "no 'ctrl/<actuator>' and no 'qpos/<joint>' column: a recording needs the commands "
                "that were sent, if there are any, and the positions that were measured"
            )

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate_hz(self) -> float:
        """Median sample rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.t)))
