"""Recordings, and the model, as a translation sees them: channels at its control rate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32

from wt.batch import Batch
from wt.errors import ModelError, RecordingError
from wt.physics.scene import Scene
from wt.types import Channel, Recording

_LONGEST = 1.5
"""Control steps between samples, beyond which nothing is known of the time between them."""
_KINDS = ("qpos", "qvel", "gyro", "gravity", "last_action", "ctrl")


@dataclass(frozen=True, eq=False)
class RecordedState:
    """States of the whole model at K times, where nothing was recorded at rest.

    Attributes:
        t: times since the recording's start [s].
        qpos: positions in MuJoCo's layout and units.
        qvel: velocities, likewise.
        ctrl: commands in force from then on.
        known: true where samples are near.
    """

    t: Float[np.ndarray, " step"]
    qpos: Float[np.ndarray, "step position"]
    qvel: Float[np.ndarray, "step dof"]
    ctrl: Float[np.ndarray, "step actuator"]
    known: Bool[np.ndarray, " step"]


class _Resampled:
    """Columns of a recording at the times of control steps.

    Attributes:
        t: times since the recording's start [s].
        known: false where samples of a column that was asked for are not near.
    """

    def __init__(
        self,
        since: Float[np.ndarray, " sample"],
        columns: Mapping[str, Float[np.ndarray, " sample"]],
        t: Float[np.ndarray, " step"],
        longest: float,
    ) -> None:
        """Prepare.

        Args:
            since: times of the samples since the recording's start [s].
            columns: of the recording.
            t: times of control steps, likewise.
            longest: gap between samples beyond which nothing in it is known [s].
        """
        self.t, self.known = t, np.ones(len(t), bool)
        self._since, self._columns, self._longest = since, columns, longest

    def column(self, name: str, hold: bool = False) -> Float[np.ndarray, " step"] | None:
        """A column, interpolated or held; None where it has fewer than two samples."""
        column = self._columns.get(name)
        if column is None or np.isfinite(column).sum() < 2:
            return None
        there = np.isfinite(column)
        times, values = self._since[there], column[there]
        after = np.searchsorted(times, self.t + 1e-9, side="right")
        after = np.clip(after, 1, len(times) - 1)
        self.known[times[after] - times[after - 1] > self._longest] = False
        self.known[np.maximum(self.t - times[-1], times[0] - self.t) > self._longest] = False
        return values[after - 1] if hold else np.interp(self.t, times, values)


class Observer:
    """Sees recordings, and the model, as a translation does.

    Attributes:
        observation: channels of o.
        action: channels of a.
        state: indices of the channels of o that the dynamics decide.
    """

    def __init__(
        self,
        scene: Scene,
        observation: Sequence[Channel],
        action: Sequence[Channel],
        rate_hz: float,
    ) -> None:
        """Find the channels in a model.

        Args:
            scene: the machine.
            observation: channels of o.
            action: channels of a, commands of actuators.
            rate_hz: control rate [Hz].

        Raises:
            ModelError: a channel names nothing in the model, or is of a kind that recordings of
                the public format do not have.
        """
        self.observation, self.action, self._rate = observation, action, rate_hz
        spec = scene.written()
        # as close to the model's own step as divides a control step
        self._substeps = max(1, math.ceil(1.0 / (rate_hz * scene.given.opt.timestep) - 1e-6))
        spec.option.timestep = 1.0 / (rate_hz * self._substeps)
        self._model = spec.compile()
        self.state = [
            i for i, c in enumerate(observation) if not c.name.startswith(("last_action/", "ctrl/"))
        ]
        still = RecordedState(
            np.zeros(1), self._model.qpos0[None], np.zeros((1, self._model.nv)),
            np.zeros((1, self._model.nu)), np.ones(1, bool),
        )  # fmt: skip
        for channels in (observation, action):
            self.seen(channels, still, still.ctrl)

    def states(self, recording: Recording) -> RecordedState:
        """A recording at the control rate, joints interpolated and commands held.

        Raises:
            RecordingError: a command of the action was not recorded.
        """
        columns = _continuous(recording.columns)
        since = recording.t - recording.t[0]
        commands = [columns[c.name] for c in self.action if c.name in columns]
        t = np.arange(_phase(since, commands, self._rate), since[-1], 1.0 / self._rate)
        resampled = _Resampled(since, columns, t, _LONGEST / self._rate)
        qpos, qvel = self._joints(resampled)
        ctrl = np.zeros((len(t), self._model.nu))
        for i in range(self._model.nu):
            value = resampled.column(f"ctrl/{self._model.actuator(i).name}", hold=True)
            if value is not None:
                ctrl[:, i] = value
        if missing := [c.name for c in self.action if c.name not in columns]:
            raise RecordingError(f"column '{missing[0]}' is missing: the translation reads it")
        _normalize(self._model, qpos)
        return RecordedState(t, qpos, qvel, ctrl, resampled.known)

    def _joints(
        self, resampled: _Resampled
    ) -> tuple[Float[np.ndarray, "step position"], Float[np.ndarray, "step dof"]]:
        """Positions and velocities of all joints; at rest where nothing was recorded."""
        m, t = self._model, resampled.t
        qpos, qvel = np.tile(m.qpos0, (len(t), 1)), np.zeros((len(t), m.nv))
        for joint in (m.joint(i) for i in range(m.njnt)):
            free = joint.type[0] == int(mujoco.mjtJoint.mjJNT_FREE)
            for width, kind, into, first in (
                (7, "qpos", qpos, int(joint.qposadr[0])),
                (6, "qvel", qvel, int(joint.dofadr[0])),
            ):
                suffixes = [f"/{k}" for k in range(width)] if free else [""]
                for k, suffix in enumerate(suffixes):
                    value = resampled.column(f"{kind}/{joint.name}{suffix}")
                    if value is None and kind == "qvel" and not free:
                        value = np.gradient(qpos[:, int(joint.qposadr[0])], t)
                    if value is not None:
                        into[:, first + k] = value
        return qpos, qvel

    def answer(self, state: RecordedState) -> RecordedState:
        """States of the model one control step after each of K states, with nothing hidden."""
        batch = Batch(self._model, len(state.t))
        batch.qpos[:], batch.qvel[:], batch.ctrl[:] = state.qpos, state.qvel, state.ctrl
        batch.step(nstep=self._substeps)
        return RecordedState(state.t, batch.qpos.copy(), batch.qvel.copy(), state.ctrl, state.known)

    def seen(
        self,
        channels: Sequence[Channel],
        state: RecordedState,
        before: Float[np.ndarray, "step actuator"],
    ) -> Float32[np.ndarray, "step channel"]:
        """Channels at some states.

        Args:
            channels: of an observation or an action.
            state: the states.
            before: commands of the control step before.
        """
        columns = [self._channel(channel.name, state, before) for channel in channels]
        return np.stack(columns, axis=1).astype(np.float32)

    def _channel(
        self, name: str, state: RecordedState, before: Float[np.ndarray, "step actuator"]
    ) -> Float[np.ndarray, " step"]:
        m = self._model
        kind, _, rest = name.partition("/")
        try:
            if kind in ("qpos", "qvel"):
                joint = m.joint(rest)
                values, first = (
                    (state.qpos, joint.qposadr) if kind == "qpos" else (state.qvel, joint.dofadr)
                )
                return np.asarray(values[:, int(first[0])])
            if kind in ("last_action", "ctrl"):
                return np.asarray(
                    (before if kind == "last_action" else state.ctrl)[:, m.actuator(rest).id]
                )
            if kind in ("gyro", "gravity") and rest in "xyz":
                return self._of_base(kind, "xyz".index(rest), state)
        except KeyError as error:
            raise ModelError(
                f"the translation is of another robot: the model has nothing of the name '{rest}'"
            ) from error
        raise ModelError(
            f"the translation reads '{name}', which no recording has; it may read "
            f"{', '.join(_KINDS)}"
        )

    def _of_base(self, kind: str, axis: int, state: RecordedState) -> Float[np.ndarray, " step"]:
        """Angular velocity of the first free body, or direction of gravity, along its own axis."""
        m = self._model
        free = np.flatnonzero(m.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        if not len(free):
            raise ModelError(f"the translation reads '{kind}', and nothing floats in the model")
        q, v = int(m.jnt_qposadr[free[0]]), int(m.jnt_dofadr[free[0]])
        if kind == "gyro":
            return np.asarray(state.qvel[:, v + 3 + axis])
        w, x, y, z = state.qpos[:, q + 3 : q + 7].T
        # −(third row of the rotation matrix)
        down = (2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1)
        return np.asarray(down[axis])


def _normalize(model: mujoco.MjModel, qpos: Float[np.ndarray, "step position"]) -> None:
    """Give the quaternions of free joints unit length, in place."""
    for j in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        first = int(model.jnt_qposadr[j]) + 3
        quat = qpos[:, first : first + 4]
        quat /= np.linalg.norm(quat, axis=1, keepdims=True)


def _continuous(
    columns: Mapping[str, Float[np.ndarray, " sample"]],
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Columns with quaternions of one sign: q and −q are one rotation, what is between is not."""
    continuous = dict(columns)
    for name in columns:
        if not (name.startswith("qpos/") and name.endswith("/3")):
            continue
        parts = [f"{name[:-1]}{k}" for k in range(3, 7)]
        if not all(part in columns for part in parts):
            continue
        quat = np.stack([columns[part] for part in parts], axis=1)
        there = np.flatnonzero(np.isfinite(quat).all(axis=1))
        along = np.sum(quat[there[1:]] * quat[there[:-1]], axis=1)
        quat[there[1:]] *= np.cumprod(np.where(along < 0, -1.0, 1.0))[:, None]
        continuous |= {part: quat[:, k] for k, part in enumerate(parts)}
    return continuous


def _phase(
    t: Float[np.ndarray, " sample"],
    commands: Sequence[Float[np.ndarray, " sample"]],
    rate_hz: float,
) -> float:
    """Begin of control steps, 0 … 1 / rate [s]: of changes of commands, as a circular mean."""
    changed = [t[1:][np.diff(np.nan_to_num(command)) != 0.0] for command in commands]
    turns = np.concatenate([*changed, [0.0]]) * rate_hz
    mean = np.angle(np.mean(np.exp(2j * np.pi * turns))) / (2 * np.pi)
    # just before zero is zero: a rounding error is no step that was missed
    return float(mean % 1.0 if mean < -1e-6 else max(mean, 0.0)) / rate_hz
