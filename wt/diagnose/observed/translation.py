"""Evidence of a trained translation: when something hidden acted, and what it cannot recover.

At every control step of a recording the model is set to R's recorded state and answers R's command,
with nothing hidden (:func:`transitions`). A translation makes of that answer what R should have
done, and ẑ, the feature that R's transition should have; R's own has the feature z. Two things
follow.

- *When.* Where z is far from ẑ, in units of how far it usually is, R's transition holds something
  that the model's does not: a push, a collision. This looks at single steps, so it sees what is too
  short to show in an error that builds up; what acts at all times does not stand out in it.
- *What no translation can recover.* What is left between R's outcome and the translated one. A
  translation corrects how something shows that the model has; what the model lacks stays (section
  "Assumptions and Scope" of the paper), and so does measurement noise, and what the translation has
  not learned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32

from wt.diagnose.evidence import ChannelLeft, Distance, Interval, Translated
from wt.diagnose.observed.observer import Observer, RecordedState
from wt.diagnose.recordings.prepare import Prepared
from wt.diagnose.result import Located
from wt.diagnose.selection.condition import merged, standing_out
from wt.diagnose.thresholds import THRESHOLDS
from wt.errors import RecordingError
from wt.physics.scene import Scene
from wt.types import Channel

_LEAST = 25
"""Control steps below which nothing is usual."""
_MOST = 0.5
"""Share of the time beyond which it is no event."""


Run = Callable[
    [
        Float32[np.ndarray, "step obs"],
        Float32[np.ndarray, "step action"],
        Float32[np.ndarray, "step obs"],
    ],
    tuple[
        Float32[np.ndarray, "step obs"],
        Float32[np.ndarray, "step latent"],
        Float32[np.ndarray, "step latent"],
    ],
]
"""A translation on arrays, as in :class:`TrainedTranslation`."""


@dataclass(frozen=True)
class TrainedTranslation:
    """A trained translation, as it was registered.

    Attributes:
        name: with its version.
        rate_hz: control rate [Hz].
        observation: channels of o.
        action: channels of a.
        run: (o, a, o′) → o′ of R where o′ is S's; z where o′ is R's; ẑ where it is S's. Physical
            units.
    """

    name: str
    rate_hz: float
    observation: tuple[Channel, ...]
    action: tuple[Channel, ...]
    run: Run


@dataclass(frozen=True, eq=False)
class _Steps:
    """Control steps of one recording.

    Attributes:
        name: of the recording.
        role: fitted or held out.
        t: beginnings of the steps [s].
        off: feature minus the expected one.
        before: R's outcome minus the model's.
        after: R's outcome minus the translated one.
    """

    name: str
    role: str
    t: Float[np.ndarray, " step"]
    off: Float[np.ndarray, "step latent"]
    before: Float[np.ndarray, "step state"]
    after: Float[np.ndarray, "step state"]


def translated(scene: Scene, prepared: Prepared, translation: TrainedTranslation) -> Translated:
    """Compare recordings with a translation of the model's own answers.

    Args:
        scene: the machine, as given.
        prepared: its recordings.
        translation: the trained one.

    Raises:
        ModelError: the translation is of another robot, or reads columns that recordings lack.
        RecordingError: a recording lacks a command, or is too short or too full of gaps.
    """
    observer = Observer(scene, translation.observation, translation.action, translation.rate_hz)
    recordings = {part.index: part.recording for part in (*prepared.fit, *prepared.held)}
    fitted = {part.index for part in prepared.fit}
    steps = []
    for index, recording in sorted(recordings.items()):
        name, role = prepared.names[index], "fit" if index in fitted else "holdout"
        try:
            steps.append(_steps(observer, observer.states(recording), translation, name, role))
        except RecordingError as error:
            raise RecordingError(f"'{name}': {error}") from error
    distances = _distances(steps)
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


def _distances(steps: Sequence[_Steps]) -> tuple[Distance, ...]:
    """Distances of features from the expected ones, in units of the usual one."""
    off = np.concatenate([s.off for s in steps])
    middle = np.median(off, axis=0)
    # 1.48 · median of deviations: the standard deviation of a Gaussian, whatever events there are
    usual = 1.4826 * np.median(np.abs(off - middle), axis=0) + 1e-9
    return tuple(
        Distance(s.name, s.t, np.sqrt(np.mean(((s.off - middle) / usual) ** 2, axis=1)))
        for s in steps
    )


def timed(locations: Sequence[Located], evidence: Translated | None) -> tuple[Located, ...]:
    """Locations, the first with a translation's events where nothing else says when."""
    if evidence is None or not locations or locations[0].intervals:
        return tuple(locations)
    return (replace(locations[0], intervals=evidence.events), *locations[1:])


def sentences(evidence: Translated) -> list[str]:
    """Sentences on a translation's evidence, for a reader."""
    words = [
        f"One control step ahead, translation by {evidence.name} leaves "
        f"{100 * evidence.left:.2g} % of the squared error of the model's own answers: what no "
        "translation of this model recovers, measurement noise and what it has not learned among "
        "it."
    ]
    if evidence.events:
        count = f"{len(evidence.events)} times" if len(evidence.events) > 1 else "once"
        words.append(
            f"Its features stand out {count} in the fitted recordings: something hidden acted then."
        )
    return words


def _steps(
    observer: Observer, state: RecordedState, translation: TrainedTranslation, name: str, role: str
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
    """Intervals in which it stands out; none if that is most of the time."""
    t = distance.t
    spans = merged(standing_out(t, distance.size, THRESHOLDS.feature_stands_out))
    if sum(end - start for start, end in spans) > _MOST * (t[-1] - t[0]):
        return []
    return [Interval(distance.name, max(start, 0.0), end) for start, end in spans]


def _rms(errors: Float[np.ndarray, "step channel"]) -> Float[np.ndarray, " channel"]:
    return np.sqrt(np.mean(errors.astype(float) ** 2, axis=0))
