"""Laws that act at every step, and the replays of a batch that they act on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wt.physics.effect import Effect
from wt.physics.hooks import OnSteps
from wt.physics.live import Live
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

_Key = tuple[int, tuple[str, str, str], int]


@dataclass(frozen=True, eq=False)
class Acting:
    """A law that acts on some replays.

    Attributes:
        rows: the replays, as rows of the batch: a slice where they are neighbours, whose states
            the law then sees and changes in place.
        live: the law, with the parameters of each.
    """

    rows: Int[np.ndarray, " row"] | slice
    live: Live


def is_live(effect: Effect) -> bool:
    """Tell whether an effect acts at every step."""
    return isinstance(effect, OnSteps)


def acting(scene: Scene, hypotheses: Sequence[Sequence[Planted]]) -> list[Acting]:
    """One law for each effect and place, in the order in which each hypothesis has them.

    So the sum of several forces does not depend, to the bit, on the other replays of a batch.

    Args:
        scene: the machine.
        hypotheses: one for each replay of a batch.
    """
    rows: dict[_Key, list[int]] = {}
    laws: dict[_Key, tuple[OnSteps, Location]] = {}
    theta: dict[_Key, list[Float[np.ndarray, " parameter"]]] = {}
    for row, hypothesis in enumerate(hypotheses):
        living = ((p, p.effect) for p in hypothesis if isinstance(p.effect, OnSteps))
        for turn, (p, effect) in enumerate(living):
            # two learned laws share an id, and are still two objects
            key = (turn, p.key, id(effect))
            laws[key] = effect, p.at
            rows.setdefault(key, []).append(row)
            theta.setdefault(key, []).append(p.theta)
    laws_acting = []
    for key, (effect, at) in sorted(laws.items(), key=lambda item: item[0][0]):
        live = effect.live(scene, at, np.stack(theta[key]))
        laws_acting.append(Acting(neighbours(rows[key]), live))
    return laws_acting


def neighbours(rows: Sequence[int] | Int[np.ndarray, " row"]) -> Int[np.ndarray, " row"] | slice:
    """A slice for rows that follow one another, whose values are then seen and not copied."""
    at = np.asarray(rows, dtype=int)
    consecutive = len(at) > 0 and bool((np.diff(at) == 1).all())
    return slice(int(at[0]), int(at[-1]) + 1) if consecutive else at
