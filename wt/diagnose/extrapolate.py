"""Replays at coarse steps, as if they had been made at steps of no length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene

Array = np.ndarray

COARSE = 2.0
"""Physics step of most replays, in fine ones; the extrapolation needs two."""
_SLOPE_STEP_S = 2e-3
"""Physics step for small differences between replays, unless coarse ones are longer [s]."""
_BOUNDED = 0.02
"""What coarse steps may change, as a share of how far a joint moves; fine ones are taken beyond."""


class Extrapolated:
    """Replays of stretches at coarse steps, plus what finer ones change at a reference.

    The steps' error is of first order, so that two step lengths tell what is left at none
    (Richardson's extrapolation). It hardly changes between hypotheses that are close.

    Attributes:
        coarse: takes the long steps.
        slopes: takes steps that do for differences between hypotheses.
        correction: what is added to the positions it says, (N, nv).
    """

    def __init__(self, scene: Scene, stretches: Sequence[Stretch], step: float) -> None:
        """Prepare.

        Args:
            scene: the machine.
            stretches: what to replay.
            step: the fine step [s].
        """
        self._fine = Replayer(scene, stretches, step)
        short = self._fine.run([()]).q[0]
        bound = _BOUNDED * np.std(short, axis=0)

        def bounded(longer: float, otherwise: Replayer) -> Replayer:
            replayer = Replayer(scene, stretches, longer)
            apart = np.sqrt(np.mean((replayer.run([()]).q[0] - short) ** 2, axis=0))
            return replayer if (apart <= bound).all() else otherwise  # NaN is none

        self.coarse = bounded(COARSE * step, self._fine)
        self.slopes = self.coarse
        if self.coarse.step < _SLOPE_STEP_S:
            self.slopes = bounded(_SLOPE_STEP_S, self.coarse)
        self.correction = np.zeros_like(short)

    def run(self, hypotheses: Sequence[Sequence[Planted]]) -> Array:
        """Positions, (H, N, nv); NaN where a replay exploded."""
        return self.coarse.run(hypotheses).q + self.correction

    def around(
        self, reference: Sequence[Planted], near: Sequence[Sequence[Planted]]
    ) -> tuple[Array, Array]:
        """Replay a reference and what is near it; the reference's correction is everybody's now.

        Returns:
            (positions of the reference, (N, nv); what is different near it, (H, N, nv)).
        """
        base, *others = self.slopes.run([reference, *near]).q
        q = base if self.slopes is self.coarse else self.coarse.run([reference]).q[0]
        if self.coarse is not self._fine:
            self.correction = np.nan_to_num(2.0 * (self._fine.run([reference]).q[0] - q))
        return q + self.correction, np.array(others).reshape(-1, *base.shape) - base
