"""DirectPred: R's outcome from (o, a) alone; its error is what the hidden variable does."""

from __future__ import annotations

import numpy as np
from torch import nn

from wt.baselines.base import Baseline, register
from wt.nets.mlp import in_chunks
from wt.train.regression import Progress
from wt.types import Pairs, Transitions


@register
class DirectPred(Baseline):
    """o′ = o + f(o, a), least squares on R."""

    name = "DirectPred"
    cost = 1.0

    def build(self) -> dict[str, nn.Module]:
        """The network f, or several, averaged."""
        self.net = self.ensemble(self.frame.n_condition)
        return {"net": self.net}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress R's change on (o, a)."""
        x, _, change = self.tensors(real)
        self.fit_ensemble(self.net, lambda rows: self.net(x[rows]) - change[rows], len(x), progress)

    def predict(self, pairs: Pairs) -> np.ndarray:
        """The average outcome at (o, a)."""
        x, _, _ = self.tensors(pairs.real)
        return self.states(pairs, in_chunks(self.net, x))
