"""The nouns of a replay: the piece of a recording, its inputs, and what its sensors say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.physics.motion import Motion, Segment


class Hidden(NamedTuple):
    """State of a joint that a patch adds, where a stretch begins.

    Attributes:
        position: [m or rad].
        velocity: [m/s or rad/s].
        unsure: deviations of both.
    """

    position: float
    velocity: float
    unsure: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of a recording that is replayed open loop from an estimated state.

    Attributes:
        recording: index of the recording.
        t: sample times since the recording's start, (K,) [s].
        command: command sent at each sample, (K, nu).
        q0: joint positions at the first sample, (nv,).
        v0: joint velocities there, (nv,).
        activation: what each drive acts on there, (nu,); filters that let the first command through
            and integrators at zero if left out.
        segment: what it was cut from, of ``motion``: hidden states are those that this led to.
        motion: the smooth recording; None if nothing is known of what was before.
        shifts: what is added to position and velocity of joints that a patch adds.
    """

    recording: int
    t: Float[np.ndarray, " sample"]
    command: Float[np.ndarray, "sample actuator"]
    q0: Float[np.ndarray, " dof"]
    v0: Float[np.ndarray, " dof"]
    activation: Float[np.ndarray, " actuator"] | None = None
    segment: Segment | None = None
    motion: Motion | None = None
    shifts: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.t)))

    def commands(self, h: float, steps: int) -> Float[np.ndarray, "step actuator"]:
        """Commands of every physics step, (steps, nu): the mean of the held ones around its start.

        MuJoCo's semi-implicit step applies a force at once to velocity and position, half a step
        before the mean of the time it stands for: commands come half a step later to make up.
        """
        integral = np.zeros_like(self.command)  # of the held command, from the first sample on
        integral[1:] = np.cumsum(self.command[:-1] * np.diff(self.t)[:, None], axis=0)
        # the first command was held before, and the last goes on being held
        knots = np.concatenate([[self.t[0] - 1.0], self.t, [self.t[-1] + 1.0]])
        integral = np.vstack([-self.command[0], integral, integral[-1] + self.command[-1]])
        edges = self.t[0] + h * (np.arange(steps + 1) - 0.5)
        means = [
            np.diff(np.interp(edges, knots, integral[:, i])) for i in range(self.command.shape[1])
        ]
        return np.stack(means, axis=1) / h if means else np.zeros((steps, 0))


@dataclass(eq=False)
class Inputs:
    """Inputs of one replay, at every physics step; effects change them in place.

    Attributes:
        recording: index of the recording.
        t: time since the recording's start of every step, (S,) [s].
        h: physics step [s].
        u: commands, (S, nu).
        force: world-frame force on bodies' centres of mass, body id → (S, 3) [N].
        torque: generalised force on degrees of freedom, dof → (S,) [N·m or N].
    """

    recording: int
    t: Float[np.ndarray, " step"]
    h: float
    u: Float[np.ndarray, "step actuator"]
    force: dict[int, Float[np.ndarray, "step 3"]] = field(default_factory=dict)
    torque: dict[int, Float[np.ndarray, " step"]] = field(default_factory=dict)

    def delayed(
        self, signal: Float[np.ndarray, " step"], delay: float
    ) -> Float[np.ndarray, " step"]:
        """A held signal (S,) that arrives ``delay`` [s] late; before, its first value."""
        edges = np.arange(len(signal) + 1) * self.h
        integral = np.concatenate([[0.0], np.cumsum(signal)]) * self.h
        start = edges[:-1] - delay
        end = edges[1:] - delay
        before = np.minimum(end, 0.0) - np.minimum(start, 0.0)
        impulse = np.interp(end, edges, integral) - np.interp(start, edges, integral)
        late: np.ndarray = (impulse + before * signal[0]) / self.h
        return late


@dataclass(eq=False)
class Outputs:
    """Reports of one replay's sensors, at every sample; effects change them in place.

    Attributes:
        recording: index of the recording.
        t: time since the recording's start, (K,) [s].
        q: joint positions, (K, nv).
        v: joint velocities, (K, nv).
    """

    recording: int
    t: Float[np.ndarray, " sample"]
    q: Float[np.ndarray, "sample dof"]
    v: Float[np.ndarray, "sample dof"]
