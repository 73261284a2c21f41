"""Laws that act at every physics step of a replay, where MuJoCo has no element for an effect."""

from __future__ import annotations

import abc
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

# Arrays are plain ones here, as in all that runs at every physics step: to check shapes would take
# longer than to compute a force.


@dataclass(slots=True)
class StepState:
    """State of replays before a physics step, as a law sees it at each of n places.

    A replay in which the law acts at several places is there as often. One is made at every step,
    so that it is not frozen, which would take longer.

    Attributes:
        t: time since the start of the recording, (n,) [s].
        h: length of the step [s].
        q: joint positions, (n, nv).
        v: joint velocities, (n, nv).
        u: commands in force, (n, nu).
    """

    t: np.ndarray
    h: float
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray


class Live(abc.ABC):
    """A law at n places, each with its own parameters; may keep a state between steps.

    Attributes:
        dofs: degree of freedom that it acts on at each place, (n,).
        own: what takes that one's value of each place out of a state's ``q`` or ``v``.
    """

    def __init__(self, dofs: Int[np.ndarray, " place"]) -> None:
        """Prepare."""
        self.dofs = dofs
        self.own = column_of_each(dofs)

    @abc.abstractmethod
    def force(self, state: StepState) -> np.ndarray:
        """Generalised force that it adds at each place, (n,) [N·m or N]; once at every step."""


def column_of_each(
    each: Int[np.ndarray, " place"],
) -> tuple[slice | Int[np.ndarray, " place"], int | Int[np.ndarray, " place"]]:
    """Index of one column in each row; of a view where that is the same one in all."""
    if len(each) and (each == each[0]).all():
        return slice(None), int(each[0])
    return np.arange(len(each)), each
