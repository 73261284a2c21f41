"""The nouns of a replay: the piece of a recording, its inputs, and what its sensors say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.physics.held import impulses
from wt.physics.motion import Motion, Segment

_LATE_S = (1e-3, 3e-3)
"""Delays [s] from which a replay's begin knows of commands before it a little, and all."""


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
        lead_t: times of the samples before, as far as they are of use, (L,) [s].
        lead: command sent at each of these, (L, nu); what is late arrives in the stretch.
        segment: what it was cut from, of ``motion``: hidden states are those that this led to.
        motion: the smooth recording; None if nothing is known of what was before.
        shifts: what is added to position and velocity of joints that a patch adds.
        unsure: deviations of ``q0`` and ``v0``, (2nv,); none if they are exact.
    """

    recording: int
    t: Float[np.ndarray, " sample"]
    command: Float[np.ndarray, "sample actuator"]
    q0: Float[np.ndarray, " dof"]
    v0: Float[np.ndarray, " dof"]
    activation: Float[np.ndarray, " actuator"] | None = None
    lead_t: Float[np.ndarray, " lead"] = field(default_factory=lambda: np.zeros(0))
    lead: Float[np.ndarray, "lead _"] = field(default_factory=lambda: np.zeros((0, 0)))
    segment: Segment | None = None
    motion: Motion | None = None
    shifts: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unsure: Float[np.ndarray, " state"] = field(default_factory=lambda: np.zeros(0))

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.t)))

    def steps_before(self, h: float) -> int:
        """Physics steps from the first sample of the lead to the stretch."""
        return int(np.ceil((self.t[0] - self.lead_t[0]) / h)) if len(self.lead_t) else 0

    def commands(self, h: float, steps: int, before: int = 0) -> Float[np.ndarray, "step actuator"]:
        """Commands of every physics step: the mean of the held ones around its start.

        Args:
            h: physics step [s].
            steps: of the stretch.
            before: further ones that lead to it.

        MuJoCo's semi-implicit step applies a force at once to velocity and position, half a step
        before the mean of the time it stands for: commands come half a step later to make up.
        """
        t, command = np.append(self.lead_t, self.t), self.command
        if len(self.lead):
            command = np.vstack([self.lead, command])
        edges = self.t[0] + h * (np.arange(-before, steps + 1) - 0.5)
        sent = impulses(t, command, edges) / h
        # what came before the first has had its effect on the state there
        sent[before] = self.command[0]
        return sent


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
        before: how many of the steps lead to the replay.
        stretch: what is replayed; None if nothing is.
    """

    recording: int
    t: Float[np.ndarray, " step"]
    h: float
    u: Float[np.ndarray, "step actuator"]
    force: dict[int, Float[np.ndarray, "step 3"]] = field(default_factory=dict)
    torque: dict[int, Float[np.ndarray, " step"]] = field(default_factory=dict)
    before: int = 0
    stretch: Stretch | None = None

    def of_replay(self) -> Inputs:
        """Without the steps that lead to it."""
        n = self.before
        force = {body: f[n:] for body, f in self.force.items()}
        torque = {dof: f[n:] for dof, f in self.torque.items()}
        return Inputs(self.recording, self.t[n:], self.h, self.u[n:], force, torque)

    def delayed(
        self, signal: Float[np.ndarray, " step"], delay: float
    ) -> Float[np.ndarray, " step"]:
        """A held signal (S,) that arrives ``delay`` [s] late; before, its first value.

        Replays begin where commands change. There even the least delay lets the one before act on,
        and none that is early does so: within what any rig is late by, none does.
        """
        held = signal.copy()
        held[: self.before] = signal[self.before]
        share = float(np.clip((delay - _LATE_S[0]) / (_LATE_S[1] - _LATE_S[0]), 0.0, 1.0))
        return self._shifted(held + share * (signal - held), delay)

    def _shifted(
        self, signal: Float[np.ndarray, " step"], delay: float
    ) -> Float[np.ndarray, " step"]:
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
