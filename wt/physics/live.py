"""Laws that act at every physics step of a replay, where MuJoCo has no element for an effect."""

from __future__ import annotations

import abc
from dataclasses import dataclass

import numpy as np

# Arrays are plain ones here, as in all that runs at every physics step: to check shapes would take
# longer than to compute a force.


@dataclass(slots=True)
class StepState:
    """State of n replays before a physics step; all arrays are of these replays only.

    One is made at every step, so that it is not frozen, which would take longer.

    Attributes:
        t: time since the start of the recording, (n,) [s].
        h: length of the step [s].
        q: joint positions, (n, nv).
        v: joint velocities, (n, nv).
        u: commands in force; writable, (n, nu).
        applied: extra generalised force on each degree of freedom; writable, (n, nv) [N·m].
    """

    t: np.ndarray
    h: float
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    applied: np.ndarray


class Live(abc.ABC):
    """Acts on some replays, each with its own parameters; may keep a state between steps."""

    @abc.abstractmethod
    def act(self, state: StepState) -> None:
        """Change commands or add generalised forces, in place."""
