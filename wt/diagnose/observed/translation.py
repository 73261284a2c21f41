"""Evidence of a trained translation: when something hidden acted, and what it cannot recover.

At every control step of a recording the model is set to R's recorded state and answers R's command,
with nothing hidden (:func:`transitions`). A translation makes of that answer what R should have
done, and ẑ, the feature that R's transition should have; what R did do has the feature z. Two
things follow.

- *When.* Where z is far from ẑ, in units of how far it usually is, R's transition holds something
  that the model's does not: a push, a collision. This looks at single steps, so it sees what is too
  short to show in an error that builds up; what acts at all times does not stand out in it.
- *What no translation can recover.* What is left between R's outcome and the translated one. A
  translation corrects how something shows that the model has; what the model lacks stays (section
  "Assumptions and Scope" of the paper), and so does measurement noise, and what the translation has
  not learned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco.batch import Batch

from wt.diagnose.evidence import ChannelLeft, Distance, Interval, Translated
from wt.diagnose.recordings.prepare import Prepared
from wt.diagnose.result import Located
from wt.diagnose.selection.condition import merged, standing_out
from wt.diagnose.thresholds import THRESHOLDS
from wt.errors import ModelError, RecordingError
from wt.physics.scene import Scene
from wt.types import Channel, Recording

Array = np.ndarray

_LEAST = 25
"""Control steps below which nothing is usual."""
_MOST = 0.5
"""Share of the time beyond which it is no event."""


@dataclass(frozen=True)
class Translation:
    """A trained translation, as it was registered.

    Attributes:
        name: with its version.
        rate_hz: control rate [Hz].
        observation: channels of o.
        action: channels of a.
        run: o (K, n_obs), a (K, n_action), o′ (K, n_obs) → o′ of R where o′ is S's, (K, n_obs);
            z where o′ is R's, (K, n_latent); ẑ where it is S's. Physical units, float32.
    """

    name: str
    rate_hz: float
    observation: tuple[Channel, ...]
    action: tuple[Channel, ...]
    run: Callable[[Array, Array, Array], tuple[Array, Array, Array]]


@dataclass(frozen=True, eq=False)
class _Steps:
    """One recording, K control steps of it."""

    name: str
    role: str
    t: Array
    off: Array  # of the feature from the expected one, (K, n_latent)
    before: Array  # R's outcome minus the model's, (K, n_state)
    after: Array  # … minus the translated one


def translated(scene: Scene, prepared: Prepared, translation: Translation) -> Translated:
    """Compare recordings with a translation of the model's own answers.

    Args:
        scene: the machine, as given.
        prepared: its recordings.
        translation: what was trained.

    Raises:
        ModelError: the translation is of another robot, or reads what recordings do not have.
        RecordingError: a recording lacks a command, or is too short or too full of gaps.
    """
    observer = Observer(scene, translation.observation, translation.action, translation.rate_hz)
    wholes = {part.index: part.recording for part in (*prepared.fit, *prepared.held)}
    fitted = {part.index for part in prepared.fit}
    steps = []
    for index, recording in sorted(wholes.items()):
        name, role = prepared.names[index], "fit" if index in fitted else "holdout"
        try:
            steps.append(_steps(observer, observer.states(recording), translation, name, role))
        except RecordingError as error:
            raise RecordingError(f"'{name}': {error}") from error
    off = np.concatenate([s.off for s in steps])
    middle = np.median(off, axis=0)
    # 1.48 · median of deviations: the standard deviation of a Gaussian, whatever events there are
    usual = 1.4826 * np.median(np.abs(off - middle), axis=0) + 1e-9
    distances = tuple(
        Distance(s.name, s.t, np.sqrt(np.mean(((s.off - middle) / usual) ** 2, axis=1)))
        for s in steps
    )
    before, after = (np.concatenate([getattr(s, n) for s in steps]) for n in ("before", "after"))
    channels = [translation.observation[i] for i in observer.state]
    return Translated(
        name=translation.name,
        channels=tuple(
            ChannelLeft(c.name, c.unit, float(b), float(a))
            for c, b, a in zip(channels, _rms(before), _rms(after), strict=True)
        ),
        distances=distances,
        events=tuple(
            event
            for s, d in zip(steps, distances, strict=True)
            if s.role == "fit"
            for event in _events(d)
        ),
    )


def timed(locations: Sequence[Located], found: Translated | None) -> tuple[Located, ...]:
    """Locations, the first with a translation's events where nothing else says when."""
    if found is None or not locations or locations[0].intervals:
        return tuple(locations)
    return (replace(locations[0], intervals=found.events), *locations[1:])


def sentences(found: Translated) -> list[str]:
    """What a reader should know of it."""
    said = [
        f"One control step ahead, translation by {found.name} leaves {100 * found.left:.2g} % of "
        "the squared error of the model's own answers: what no translation of this model recovers, "
        "measurement noise and what it has not learned among it."
    ]
    if found.events:
        count = f"{len(found.events)} times" if len(found.events) > 1 else "once"
        said.append(
            f"Its features stand out {count} in the fitted recordings: something hidden acted then."
        )
    return said


def _steps(
    observer: Observer, state: State, translation: Translation, name: str, role: str
) -> _Steps:
    t, ctrl = state.t, state.ctrl
    before = np.concatenate([ctrl[:1], ctrl[:-1]])
    seen = observer.seen(translation.observation, state, before)
    answer = observer.seen(translation.observation, observer.answer(state), ctrl)
    a = observer.seen(translation.action, state, ctrl)
    use = np.flatnonzero(state.known[:-1] & state.known[1:])
    if len(use) < _LEAST:
        raise RecordingError(
            f"only {len(use)} control steps at {translation.rate_hz:g} Hz have samples on both "
            f"sides, {_LEAST} are needed to compare them with a translation"
        )
    o, a, real, sim = seen[use], a[use], seen[use + 1], answer[use]
    outcome, _, expected = translation.run(o, a, sim)
    _, feature, _ = translation.run(o, a, real)
    own = observer.state
    return _Steps(
        name, role, t[use], feature - expected,
        real[:, own] - sim[:, own], real[:, own] - outcome[:, own],
    )  # fmt: skip


def _events(distance: Distance) -> list[Interval]:
    """When it stands out; nothing if that is most of the time."""
    t = distance.t
    spans = merged(standing_out(t, distance.size, THRESHOLDS.feature_stands_out))
    if sum(end - start for start, end in spans) > _MOST * (t[-1] - t[0]):
        return []
    return [Interval(distance.name, max(start, 0.0), end) for start, end in spans]


def _rms(errors: Array) -> Array:
    return np.sqrt(np.mean(errors.astype(float) ** 2, axis=0))


_LONGEST = 1.5
"""Samples further apart than so many control steps tell nothing of what was between them."""
_KINDS = ("qpos", "qvel", "gyro", "gravity", "last_action", "ctrl")


@dataclass(frozen=True, eq=False)
class State:
    """States of the whole model at K times, where nothing was recorded at rest.

    Attributes:
        t: times since the recording's start, (K,) [s].
        qpos: (K, nq), in MuJoCo's layout and units.
        qvel: (K, nv).
        ctrl: commands in force from then on, (K, nu).
        known: whether samples are near, (K,) bool.
    """

    t: Array
    qpos: Array
    qvel: Array
    ctrl: Array
    known: Array


class Observer:
    """Sees recordings, and the model, as a translation does.

    Attributes:
        observation: channels of o.
        action: channels of a.
        state: which channels of o the dynamics decide, (n,) indices.
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
        still = State(
            np.zeros(1), self._model.qpos0[None], np.zeros((1, self._model.nv)),
            np.zeros((1, self._model.nu)), np.ones(1, bool),
        )  # fmt: skip
        for channels in (observation, action):
            self.seen(channels, still, still.ctrl)

    def states(self, recording: Recording) -> State:
        """A recording at the control rate, joints interpolated and commands held.

        Raises:
            RecordingError: a command of the action was not recorded.
        """
        m, columns = self._model, _continuous(recording.columns)
        since = recording.t - recording.t[0]
        begin = _phase(
            since, [columns[c.name] for c in self.action if c.name in columns], self._rate
        )
        t = np.arange(begin, since[-1], 1.0 / self._rate)
        qpos, qvel = np.tile(m.qpos0, (len(t), 1)), np.zeros((len(t), m.nv))
        ctrl, known = np.zeros((len(t), m.nu)), np.ones(len(t), bool)

        def at(name: str, held: bool = False) -> Array | None:
            column = columns.get(name)
            if column is None or np.isfinite(column).sum() < 2:
                return None
            there = np.isfinite(column)
            times, values = since[there], column[there]
            after = np.clip(np.searchsorted(times, t + 1e-9, side="right"), 1, len(times) - 1)
            longest = _LONGEST / self._rate
            known[times[after] - times[after - 1] > longest] = False
            known[np.maximum(t - times[-1], times[0] - t) > longest] = False
            return values[after - 1] if held else np.interp(t, times, values)

        for joint in (m.joint(i) for i in range(m.njnt)):
            free = joint.type[0] == int(mujoco.mjtJoint.mjJNT_FREE)
            for width, kind, into, first in (
                (7, "qpos", qpos, int(joint.qposadr[0])),
                (6, "qvel", qvel, int(joint.dofadr[0])),
            ):
                names = [f"/{k}" for k in range(width)] if free else [""]
                for k, suffix in enumerate(names):
                    value = at(f"{kind}/{joint.name}{suffix}")
                    if value is None and kind == "qvel" and not free:
                        value = np.gradient(qpos[:, int(joint.qposadr[0])], t)
                    if value is not None:
                        into[:, first + k] = value
        for i in range(m.nu):
            value = at(f"ctrl/{m.actuator(i).name}", held=True)
            if value is not None:
                ctrl[:, i] = value
        if missing := [c.name for c in self.action if c.name not in columns]:
            raise RecordingError(f"column '{missing[0]}' is missing: the translation reads it")
        _normalize(m, qpos)
        return State(t, qpos, qvel, ctrl, known)

    def answer(self, state: State) -> State:
        """Where the model goes in one control step from each of K states, with nothing hidden."""
        batch = Batch(self._model, len(state.t))
        batch.qpos[:], batch.qvel[:], batch.ctrl[:] = state.qpos, state.qvel, state.ctrl
        batch.step(nstep=self._substeps)
        return State(state.t, batch.qpos.copy(), batch.qvel.copy(), state.ctrl, state.known)

    def seen(self, channels: Sequence[Channel], state: State, before: Array) -> Array:
        """Channels at K states, (K, n), float32.

        Args:
            channels: of an observation or an action.
            state: the states.
            before: commands of the control step before, (K, nu).
        """
        columns = [self._channel(channel.name, state, before) for channel in channels]
        return np.stack(columns, axis=1).astype(np.float32)

    def _channel(self, name: str, state: State, before: Array) -> Array:
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

    def _of_base(self, kind: str, axis: int, state: State) -> Array:
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


def _normalize(model: mujoco.MjModel, qpos: Array) -> None:
    """Give the quaternions of free joints unit length, in place."""
    for j in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        first = int(model.jnt_qposadr[j]) + 3
        quat = qpos[:, first : first + 4]
        quat /= np.linalg.norm(quat, axis=1, keepdims=True)


def _continuous(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Columns with quaternions of one sign: q and −q are one rotation, what is between is not."""
    found = dict(columns)
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
        found |= {part: quat[:, k] for k, part in enumerate(parts)}
    return found


def _phase(t: Array, commands: Sequence[Array], rate_hz: float) -> float:
    """When control steps begin, 0 … 1 / rate [s]: where commands change, as a circular mean."""
    changed = [t[1:][np.diff(np.nan_to_num(command)) != 0.0] for command in commands]
    turns = np.concatenate([*changed, [0.0]]) * rate_hz
    mean = np.angle(np.mean(np.exp(2j * np.pi * turns))) / (2 * np.pi)
    # just before zero is zero: a rounding error is no step that was missed
    return float(mean % 1.0 if mean < -1e-6 else max(mean, 0.0)) / rate_hz
