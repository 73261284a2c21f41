"""What a trained translation says of recordings: when something hidden acted, and what it misses.

At every control step of a recording the model is set to R's recorded state and answers R's command,
with nothing hidden. A translation makes of that answer what R should have done, and ẑ, the feature
that R's transition should have; what R did do has the feature z. Two things follow.

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

from wt.diagnose.condition import merged, standing_out
from wt.diagnose.evidence import ChannelLeft, Distance, Translated
from wt.diagnose.observe import Observer, State
from wt.diagnose.prepare import Prepared
from wt.diagnose.result import Interval, Located
from wt.errors import RecordingError
from wt.physics.scene import Scene
from wt.types import Channel

Array = np.ndarray

STANDS_OUT = 2.5
"""Times the usual distance of z from ẑ, from which something hidden acted."""
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
    spans = merged(standing_out(t, distance.size, STANDS_OUT))
    if sum(end - start for start, end in spans) > _MOST * (t[-1] - t[0]):
        return []
    return [Interval(distance.name, max(start, 0.0), end) for start, end in spans]


def _rms(errors: Array) -> Array:
    return np.sqrt(np.mean(errors.astype(float) ** 2, axis=0))
