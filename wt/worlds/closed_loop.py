"""Contract of a world whose policy can be run on predicted states (multi-step rollouts).

A rollout starts from a state of R and goes on without R: the policy acts on the prediction, the
simulator answers, a method turns its answer into the next prediction, and the simulator's
observable state is overwritten with that. What is hidden stays as the simulator left it, or is
moved so that standing feet stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32

from wt.types import Domain, TransitionSpec


@dataclass(frozen=True)
class ReferenceRollouts:
    """Robots of R under the policy, from which rollouts start and with which they are compared.

    Each has past + horizon steps, hence one more instant.

    Attributes:
        o: observations; rollouts start at instant ``past``.
        a: actions that R's policy took.
        hidden: hidden variables.
        context: inputs of the policy besides the observation: they depend on time and commands
            alone, so that they are the same for every rollout.
        past: steps before the start, as a history for methods that read one.
    """

    o: Float[np.ndarray, "robot instant obs"]
    a: Float[np.ndarray, "robot step action"]
    hidden: Float[np.ndarray, "robot instant hidden"]
    context: Float[np.ndarray, "robot step context"]
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

    def sim_step(
        self,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot action"],
        hidden: Float[np.ndarray, "robot hidden"] | None,
    ) -> Float32[np.ndarray, "robot state"]:
        """S's answer, also with nothing hidden; see :class:`wt.worlds.base.World`."""
        ...

    def truth(self, count: int, past: int, horizon: int, seed: int) -> ReferenceRollouts:
        """R under its policy, without exploration noise; at most ``count`` robots.

        Robots that leave the bounds of :meth:`astray` in R itself are left out.
        """
        ...

    def act(
        self, o: Float[np.ndarray, "robot obs"], context: Float[np.ndarray, "robot context"]
    ) -> Float[np.ndarray, "robot action"]:
        """The policy's actions."""
        ...

    def advance(
        self,
        domain: Domain,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot action"],
        hidden: Float[np.ndarray, "robot hidden"],
    ) -> tuple[Float32[np.ndarray, "robot state"], Float[np.ndarray, "robot hidden"]]:
        """One control step of a domain, set to a state.

        Returns:
            The state channels one control step later, and the hidden variables then.
        """
        ...

    def stance(
        self,
        answer: Float[np.ndarray, "robot state"],
        target: Float[np.ndarray, "robot state"],
        hidden: Float[np.ndarray, "robot hidden"],
    ) -> Float[np.ndarray, "robot hidden"]:
        """S's hidden variables with which standing feet stay when its observable state changes.

        Args:
            answer: S's state channels after a step.
            target: state channels that overwrite them.
            hidden: S's hidden variables after the step.
        """
        ...

    def astray(
        self, s: Float[np.ndarray, "robot state"], hidden: Float[np.ndarray, "robot hidden"]
    ) -> Bool[np.ndarray, " robot"]:
        """True where a state with its hidden variables is out of bounds."""
        ...
