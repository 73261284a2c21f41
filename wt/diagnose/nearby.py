"""What the rig's errors and other initial states change in replays close to a hypothesis."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from wt.diagnose.adapt import responses
from wt.diagnose.extrapolate import Extrapolated
from wt.diagnose.nuisance import Nuisance
from wt.physics.planted import Key, Planted

Array = np.ndarray

_STEP = 0.1
"""Change of an error for its derivative [deviations]: long valleys need good ones."""
ROUGH = 10.0
"""So many times as large are differences on legs: a foot lands a physics step earlier or later
after the smallest change, and what that does must not pass for a slope."""


class Nearby:
    """Finite differences of replays, by which they are linear around a hypothesis.

    A floating base has many links and as many unknown initial speeds; what they change is computed
    once there for hypotheses of the same effects, whatever their parameters.

    Attributes:
        nudge: differences are so many times as large as where replays are smooth.
        some: errors of the rig.
        able: which of them a model can hold, (n,) bool.
    """

    def __init__(
        self, replays: Extrapolated, some: Sequence[Nuisance], deviations: Array, once: bool
    ) -> None:
        """Prepare.

        Args:
            replays: of the stretches.
            some: errors of the rig.
            deviations: of initial positions and velocities, (2nv,); empty if they are forgotten.
            once: whether to compute what changes once for the same effects.
        """
        self._replays, self._deviations, self._once = replays, deviations, once
        self.nudge = ROUGH if once else 1.0
        self._step = _STEP * self.nudge
        self.some = tuple(some)
        self.able = np.array([n.correctable for n in some], dtype=bool)
        self._known: tuple[tuple[Key, ...], Array, Array] | None = None

    def on(self, replays: Extrapolated) -> Nearby:
        """The same differences of other replays of the same stretches."""
        other = copy.copy(self)
        other._replays = replays
        return other

    def rig(self, sizes: Array) -> tuple[Planted, ...]:
        """Errors of so many deviations, those that a model can hold."""
        pairs = zip(self.some, sizes, strict=True)
        return tuple(n.scaled(float(x)) for n, x in pairs if n.correctable and x)

    def around(self, hypothesis: Sequence[Planted], centre: Array) -> tuple[Array, Array, Array]:
        """Replay a hypothesis with the rig's errors at ``centre`` [deviations].

        Returns:
            (positions, (N, nv); what changes per deviation of each error, (n, N, nv); what changes
            per deviation of each initial state, (N, nv, 2nv), of no width if it is forgotten).
        """
        here = (*hypothesis, *self.rig(centre))
        keys = tuple(p.key for p in hypothesis)
        if self._known is not None and self._known[0] == keys:
            return self._replays.around(here, [])[0], *self._known[1:]
        moved = [
            (*hypothesis, *self.rig(centre + one)) if n.correctable else (*here, n.planted)
            for n, one in zip(self.some, self._step * np.eye(len(self.some)), strict=True)
        ]
        q, changes = self._replays.around(here, moved)
        changes = np.nan_to_num(changes) / np.where(self.able, self._step, 1.0)[:, None, None]
        response = np.zeros((*q.shape, 0))
        if self._deviations.size:
            response = responses(self._replays.slopes, here, self._deviations)
        self._known = (keys, changes, response) if self._once else None
        return q, changes, response
