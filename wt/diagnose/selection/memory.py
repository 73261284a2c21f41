"""What additions were worth when they were last replayed, where nothing has changed since.

A round finds what joins at one joint or two, and leaves what replays miss at the others as it was:
so it leaves what each addition gains there. Greedy selection may be lazy about these (M. Minoux,
1978): where nothing came near to earning its place nothing is replayed again, and else only that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.diagnose.likelihood.bic import worth
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.selection.candidates import Start
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Key, Planted

_SAME = 0.1
"""Change of what is left at a joint, as a share of it, that changes nothing there."""
_NEAR = 0.5
"""Share of the nats that an effect has to earn from which one may earn them yet."""


class _Joint(NamedTuple):
    """What a joint was like when additions at it were replayed.

    Attributes:
        left: by its replays [rad or m].
        tried: what was replayed.
        near: what came near to earning its place, alone or two together, as refined.
    """

    left: Float[np.ndarray, " sample"]
    tried: set[Key]
    near: list[tuple[Planted, ...]]


class Memory:
    """Additions of earlier rounds of one search, joint by joint.

    Where a base floats all joints err together, and nothing is remembered.
    """

    def __init__(self, objective: Objective) -> None:
        """Remember nothing yet of these replays."""
        self._objective = objective
        self._known: dict[int, _Joint] = {}
        self._asked: dict[int, tuple[set[Key], Float[np.ndarray, " sample"]]] = {}
        self._asked_together: set[tuple[frozenset[int], frozenset[Key]]] = set()

    def same(self, now: Assessed) -> set[int]:
        """Degrees of freedom at which what is left has stayed as it was when they were tried."""
        left = self._objective.left(now)
        return {d for d, joint in self._known.items() if _close(joint.left, left[:, d])}

    def narrowed(self, starts: Sequence[Start], same: Iterable[int]) -> list[Start]:
        """Starts without those that have been tried where nothing has changed.

        What came near to earning its place there stays, and starts from where it was refined to.
        """
        scene, known = self._objective.scene, {d: self._known[d] for d in same}
        shapes = {p.key: shape for p, shape in starts}
        tried = {key for joint in known.values() for key in joint.tried}
        near = [parts[0] for joint in known.values() for parts in joint.near if len(parts) == 1]
        fresh = [(p, s) for p, s in starts if scene.dof_at(p.at) not in known or p.key not in tried]
        return [*((p, shapes[p.key]) for p in near if p.key in shapes), *fresh]

    def pairs(self, same: Iterable[int]) -> list[tuple[Planted, ...]]:
        """Pairs that came near to earning their place where nothing has changed."""
        return [parts for d in same for parts in self._known[d].near if len(parts) == 2]

    def unasked(self, now: Assessed, dof: int) -> bool:
        """Tell, once, whether a joint has other effects, or other errors, than when last asked.

        Where a base floats all joints err together, and it is no joint's turn.
        """
        scene, left = self._objective.scene, self._objective.left(now)[:, dof]
        has = {p.key for p in now.hypothesis if scene.dof_at(p.at) == dof}
        before = self._asked.get(dof)
        if scene.free or (before and before[0] == has and _close(before[1], left)):
            return False
        self._asked[dof] = has, left.copy()
        return True

    def unasked_together(self, now: Assessed, dofs: Collection[int]) -> bool:
        """Tell, once, whether several joints have not been asked together with what they have."""
        scene = self._objective.scene
        has = frozenset(p.key for p in now.hypothesis if scene.dof_at(p.at) in dofs)
        asked = frozenset(dofs), has
        if scene.free or asked in self._asked_together:
            return False
        self._asked_together.add(asked)
        return True

    def note(
        self,
        now: Assessed,
        starts: Sequence[Start],
        fits: Sequence[Assessed],
        same: Iterable[int],
    ) -> None:
        """Remember what was tried beside the present hypothesis, and what came of it.

        Args:
            now: the present hypothesis.
            starts: what was replayed.
            fits: of additions.
            same: degrees of freedom of which something was known before; it stays, and what was
                tried for the first time joins it.
        """
        scene, left, before = self._objective.scene, self._objective.left(now), set(same)
        least, count = _NEAR * THRESHOLDS.min_nats, len(now.hypothesis)
        if scene.free:
            return
        at = {p.key: scene.dof_at(p.at) for p, _ in starts}
        for dof in {d for d in at.values() if d >= 0}:
            here = [f for f in fits if scene.dof_at(f.hypothesis[-1].at) == dof]
            near = [f.hypothesis[count:] for f in here if worth(self._objective, f, now) > least]
            tried = {key for key, d in at.items() if d == dof}
            if dof in before:
                known = self._known[dof]
                tried |= known.tried
                self._known[dof] = known._replace(tried=tried, near=near)
            else:
                self._known[dof] = _Joint(left[:, dof].copy(), tried, near)


def _close(one: Float[np.ndarray, " sample"], other: Float[np.ndarray, " sample"]) -> bool:
    return bool(np.linalg.norm(other - one) <= _SAME * np.linalg.norm(one))
