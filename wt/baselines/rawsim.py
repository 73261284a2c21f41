"""RawSim: the simulator's answer as it is; its error is the gap between the domains."""

from __future__ import annotations

import numpy as np

from wt.baselines.base import Baseline, register
from wt.train.regression import Progress
from wt.types import Pairs, Transitions


@register
class RawSim(Baseline):
    """o′ = o′_S, with S given the true hidden variable."""

    name = "RawSim"
    trains_on = ()
    cost = 0.0

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Nothing to learn."""

    def predict(self, pairs: Pairs) -> np.ndarray:
        """S's answer."""
        return pairs.sim_next
