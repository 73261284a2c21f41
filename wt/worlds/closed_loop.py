"""What a world adds so that its policy can be run on predicted states (multi-step rollouts).

A rollout starts from a state of R and goes on without R: the policy acts on the prediction, the
simulator answers, a method turns its answer into the next prediction, and the simulator's
observable state is overwritten with that. What is hidden stays as the simulator left it, or is
moved so that standing feet stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from wt.types import Domain, TransitionSpec

Array = np.ndarray


@dataclass(frozen=True)
class ReferenceRollouts:
    """N robots of R under the policy: what rollouts start from and are compared with.

    Attributes:
        o: observations, (N, past + horizon + 1, n_obs); rollouts start at index ``past``.
        a: actions that R's policy took, (N, past + horizon, n_action).
        hidden: hidden variables, (N, past + horizon + 1, n_hidden).
        context: what the policy sees beside the observation, (N, past + horizon, n_context): it
            depends on time and commands alone, so that it is the same for every rollout.
        past: steps before the start, as a history for those who read one.
    """

    o: Array
    a: Array
    hidden: Array
    context: Array
    past: int

    def __len__(self) -> int:
        """Number of robots."""
        return len(self.o)

    @property
    def horizon(self) -> int:
        """Steps of a rollout."""
        return self.a.shape[1] - self.past


@runtime_checkable
class ClosedLoop(Protocol):
    """A world whose policy can be run on predicted states.

    Its observation is the state followed by the last action.
    """

    spec: TransitionSpec

    def sim_step(self, o: Array, a: Array, hidden: Array | None) -> Array:
        """S's answer, also with nothing hidden; see :class:`wt.worlds.base.World`."""
        ...

    def truth(self, count: int, past: int, horizon: int, seed: int) -> ReferenceRollouts:
        """R under its policy, without exploration noise; at most ``count`` robots.

        Robots that leave the bounds of :meth:`astray` in R itself are left out.
        """
        ...

    def act(self, o: Array, context: Array) -> Array:
        """The policy's actions at observations (N, n_obs), (N, n_action)."""
        ...

    def advance(self, domain: Domain, o: Array, a: Array, hidden: Array) -> tuple[Array, Array]:
        """One control step of a domain, set to a state.

        Returns:
            The state channels one control step later, (N, n_state), float32, and the hidden
            variables then, (N, n_hidden).
        """
        ...

    def stance(self, answer: Array, target: Array, hidden: Array) -> Array:
        """What is hidden in S, where its standing feet stay when its observable state changes.

        Args:
            answer: S's state channels after a step, (N, n_state).
            target: those that overwrite them, (N, n_state).
            hidden: S's hidden variables after the step, (N, n_hidden).

        Returns:
            (N, n_hidden).
        """
        ...

    def astray(self, s: Array, hidden: Array) -> Array:
        """Which states (N, n_state) with their hidden variables are out of bounds, (N,) bool."""
        ...
