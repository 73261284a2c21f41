"""Which laws act at every step on which replays of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wt.physics.effect import Effect
from wt.physics.live import Live
from wt.physics.replay import Planted
from wt.physics.scene import Scene

Array = np.ndarray

_Key = tuple[int, tuple[str, str, str], int]


@dataclass(frozen=True, eq=False)
class Acting:
    """A law that acts on some replays.

    Attributes:
        rows: the replays, as rows of the batch: a slice where they are neighbours, whose states
            the law then sees and changes in place.
        live: the law, with the parameters of each.
    """

    rows: Array | slice
    live: Live


def is_live(effect: Effect) -> bool:
    """Whether an effect acts at every step."""
    return type(effect).live is not Effect.live


def acting(scene: Scene, hypotheses: Sequence[Sequence[Planted]]) -> list[Acting]:
    """One law for each effect and place, in the order in which each hypothesis has them.

    So the sum of several forces does not depend, to the bit, on the other replays of a batch.

    Args:
        scene: the machine.
        hypotheses: one for each replay of a batch.
    """
    rows: dict[_Key, list[int]] = {}
    planted: dict[_Key, list[Planted]] = {}
    for row, hypothesis in enumerate(hypotheses):
        for turn, p in enumerate(p for p in hypothesis if is_live(p.effect)):
            # two learned laws share an id, and are still two objects
            key = (turn, p.key, id(p.effect))
            rows.setdefault(key, []).append(row)
            planted.setdefault(key, []).append(p)
    found = []
    for same, some in sorted(planted.items(), key=lambda item: item[0][0]):
        live = some[0].effect.live(scene, some[0].at, np.stack([p.theta for p in some]))
        if live is not None:
            found.append(Acting(_neighbours(rows[same]), live))
    return found


def _neighbours(rows: list[int]) -> Array | slice:
    first, last = rows[0], rows[-1]
    whole = rows == list(range(first, last + 1))
    return slice(first, last + 1) if whole else np.array(rows)
