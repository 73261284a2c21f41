"""Laws that act at every step, and the replays of a batch that they act on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from wt.physics.effect import Effect
from wt.physics.hooks import OnSteps
from wt.physics.live import Live
from wt.physics.planted import Planted
from wt.physics.scene import Scene


@dataclass(frozen=True, eq=False)
class Acting:
    """A law that acts in some replays, at one place or more of each.

    Attributes:
        rows: the replay of each place, as rows of the batch: a slice where they are neighbours,
            whose states the law then sees without a copy.
        live: the law, with the parameters at each place.
        cells: where the force of each place goes, among those of all replays one after another.
        twice: whether two places in a replay act on the same degree of freedom.
    """

    rows: Int[np.ndarray, " place"] | slice
    live: Live
    cells: Int[np.ndarray, " place"]
    twice: bool

    def add(self, force: np.ndarray, to: np.ndarray) -> None:
        """Add the force at each place, (n,), to those of all replays, in place [N·m or N].

        Those are (replays · nv,), one after another.
        """
        if self.twice:
            np.add.at(to, self.cells, force)
        else:
            to[self.cells] += force


def is_live(effect: Effect) -> bool:
    """Tell whether an effect acts at every step."""
    return isinstance(effect, OnSteps)


def acting(scene: Scene, hypotheses: Sequence[Sequence[Planted]]) -> list[Acting]:
    """One law for each effect, wherever it acts: twelve joints take one call, not twelve.

    In the order of names, so that the sum of several forces does not depend, to the bit, on
    the other replays of a batch.

    Args:
        scene: the machine.
        hypotheses: one for each replay of a batch.
    """
    # two learned laws share a name, and are still two objects
    laws: dict[int, OnSteps] = {}
    places: dict[int, list[tuple[int, Planted]]] = {}
    for row, hypothesis in enumerate(hypotheses):
        for p in hypothesis:
            if isinstance(p.effect, OnSteps):
                laws[id(p.effect)] = p.effect
                places.setdefault(id(p.effect), []).append((row, p))
    laws_acting = []
    for key in sorted(laws, key=lambda key: laws[key].id):
        there = sorted(places[key], key=lambda place: (place[0], place[1].at.name))
        rows, planted = np.array([row for row, _ in there]), [p for _, p in there]
        theta = np.stack([p.theta for p in planted])
        live = laws[key].live(scene, [p.at for p in planted], theta)
        cells = rows * scene.model.nv + live.dofs
        twice = len(np.unique(cells)) < len(cells)
        laws_acting.append(Acting(neighbours(rows), live, cells, twice))
    return laws_acting


def neighbours(rows: Sequence[int] | Int[np.ndarray, " row"]) -> Int[np.ndarray, " row"] | slice:
    """A slice for rows that follow one another, whose values are then seen and not copied."""
    at = np.asarray(rows, dtype=int)
    consecutive = len(at) > 0 and bool((np.diff(at) == 1).all())
    return slice(int(at[0]), int(at[-1]) + 1) if consecutive else at
