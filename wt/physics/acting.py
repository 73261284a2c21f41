"""Laws that act at every step, and the replays of a batch that they act on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wt.physics.effect import Effect
from wt.physics.hooks import Limiting, OnSteps
from wt.physics.live import Live
from wt.physics.planted import Planted
from wt.physics.scene import Scene

_Most = tuple[tuple[str, float], ...]
_Group = tuple[int, _Most]
"""A law, and the limits of the drives that it sees."""


@dataclass(frozen=True, eq=False)
class Acting:
    """The laws that act in the replays of a batch, place after place, for compiled code.

    Attributes:
        laws: address of the law at each place.
        places: replay, as row of the batch, and degree of freedom of each.
        figures: address of the parameters, and of what else is its own, of each.
        tables: what lies at those addresses.
    """

    laws: Int[np.ndarray, " place"]
    places: Int[np.ndarray, "place 2"]
    figures: Int[np.ndarray, "place 2"]
    tables: tuple[Float[np.ndarray, "_ _"], ...]


def is_live(effect: Effect) -> bool:
    """Tell whether an effect acts at every step."""
    return isinstance(effect, OnSteps)


def any_live(hypothesis: Sequence[Planted]) -> bool:
    """Tell whether one of several does."""
    return any(is_live(p.effect) for p in hypothesis)


def acting(scene: Scene, hypotheses: Sequence[Sequence[Planted]], h: float) -> Acting | None:
    """The laws of hypotheses; None if none of them has one.

    In the order of names, so that the sum of several forces does not depend, to the bit, on how a
    hypothesis lists them.

    Args:
        scene: the machine.
        hypotheses: one for each replay of a batch.
        h: physics step [s].
    """
    # two learned laws share a name, and are still two objects
    laws: dict[_Group, OnSteps] = {}
    places: dict[_Group, list[tuple[int, Planted]]] = {}
    # many rows have the same one, each on a stretch of its own
    each = {id(h): (_most(h), _laws(h)) for h in hypotheses}
    for row, hypothesis in enumerate(hypotheses):
        most, there = each[id(hypothesis)]
        for law, p in there:
            laws[id(law), most] = law
            places.setdefault((id(law), most), []).append((row, p))
    parts = []
    for key in sorted(laws, key=lambda key: (laws[key].id, key[1])):
        ordered = sorted(places[key], key=lambda place: (place[0], place[1].at.name))
        rows, planted = np.array([row for row, _ in ordered]), [p for _, p in ordered]
        theta = np.stack([p.theta for p in planted])
        seen = scene.limited(dict(key[1])) if key[1] else scene
        live = laws[key].live(seen, [p.at for p in planted], theta, h)
        parts.append((rows, live))
    return _side_by_side(parts) if parts else None


def _laws(hypothesis: Sequence[Planted]) -> list[tuple[OnSteps, Planted]]:
    """Those of a hypothesis that act at every step, each with where it is planted."""
    return [(p.effect, p) for p in hypothesis if isinstance(p.effect, OnSteps)]


def _most(hypothesis: Sequence[Planted]) -> _Most:
    """What drives give on their joints at most, by name, where a hypothesis limits them."""
    return tuple(
        sorted(
            (p.at.name, p.effect.most(p.theta))
            for p in hypothesis
            if isinstance(p.effect, Limiting)
        )
    )


def _side_by_side(parts: Sequence[tuple[Int[np.ndarray, " _"], Live]]) -> Acting:
    """All places of laws, given with the replays that each acts in."""
    from wt.physics.compiled import address  # takes a second to import

    tables, figures = list[np.ndarray](), []
    for _, live in parts:
        pair = [np.array(table, dtype=float, order="C") for table in (live.theta, live.own)]
        figures.append(np.stack([_addresses(table) for table in pair], axis=1))
        tables += pair
    return Acting(
        laws=np.concatenate([np.full(len(rows), address(live.law)) for rows, live in parts]),
        places=np.concatenate([np.stack([rows, live.dofs], axis=1) for rows, live in parts]),
        figures=np.concatenate(figures),
        tables=tuple(tables),
    )


def _addresses(table: Float[np.ndarray, "place figure"]) -> Int[np.ndarray, " place"]:
    """Where each row of a table begins."""
    return table.ctypes.data + table.strides[0] * np.arange(len(table))
