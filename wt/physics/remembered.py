"""Replays that were run lately, to be told again instead of run again.

A search comes back to many a hypothesis: to begin a refinement, to linearise around it, to prove
it. And what it changes at one limb of a machine leaves the others what they were.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.physics.planted import Planted

Paths = Float[np.ndarray, "2 hypothesis sample dof"]
"""Positions and velocities that hypotheses lead to."""
Contents = bytes
"""What two hypotheses have in common that say the same: each effect, where and how large."""

_BYTES = 2**26
"""What is remembered at most, of each of the dozen stretches and steps that a diagnosis uses."""


def contents(hypothesis: Sequence[Planted]) -> Contents:
    """What says the same as this hypothesis, as long as its effects live."""
    return b"".join([p.contents for p in hypothesis])


class _Said(NamedTuple):
    """What a hypothesis said; it is kept so that nothing else takes its effects' ids."""

    hypothesis: Sequence[Planted]
    path: Float[np.ndarray, "2 sample dof"]


class Remembered:
    """The latest replays of some stretches, up to some bytes of them."""

    def __init__(self) -> None:
        """Remember nothing yet."""
        self._said: dict[Contents, _Said] = {}

    def paths(
        self,
        hypotheses: Sequence[Sequence[Planted]],
        replay: Callable[[list[Sequence[Planted]]], Paths],
    ) -> Paths:
        """What hypotheses lead to, each of the new ones replayed once.

        Args:
            hypotheses: one or more.
            replay: replays some of them.
        """
        asked = [contents(h) for h in hypotheses]
        each = dict(zip(asked, hypotheses, strict=True))
        known = {key: self._said.pop(key) for key in each if key in self._said}
        new = [key for key in each if key not in known]
        if new:
            paths = replay([each[key] for key in new])
            known |= {key: _Said(each[key], paths[:, i].copy()) for i, key in enumerate(new)}
        self._said |= known  # the latest come last
        most = max(1, _BYTES // max(1, known[asked[0]].path.nbytes))
        for oldest in list(self._said)[:-most]:
            del self._said[oldest]
        return np.stack([known[key].path for key in asked], axis=1)
