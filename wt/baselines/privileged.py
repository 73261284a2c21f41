"""PrivilegedPred: DirectPred that is told what is hidden, which nobody is in use.

A method that infers the hidden variables from the past can at best know them; how far this one
is below DirectPred is therefore what a history could gain on a task, with the shared budget.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, in_chunks, register
from wt.data.normalize import Normalizer
from wt.train.regression import Progress, regress
from wt.types import Pairs, Transitions


@register
class PrivilegedPred(Baseline):
    """o′ = o + f(o, a, h), least squares on R."""

    name = "PrivilegedPred"

    def build(self) -> dict[str, nn.Module]:
        """The network f, and the scales of h."""
        n_hidden = len(self.spec.hidden)
        self.hidden = Normalizer(n_hidden)
        self.net = self.network(self.frame.n_condition + n_hidden)
        return {"hidden": self.hidden, "net": self.net}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress R's change on (o, a, h)."""
        if len(self.spec.hidden):
            self.hidden.fit(real.hidden)
        inputs, change = self._inputs(real)
        regress(
            self.net,
            lambda rows: self.net(inputs[rows]) - change[rows],
            len(inputs),
            self.budget(),
            progress=progress,
            score=self.score(),
        )

    def predict(self, pairs: Pairs) -> np.ndarray:
        """The outcome at (o, a, h)."""
        return self.states(pairs, in_chunks(self.net, self._inputs(pairs.real)[0]))

    @torch.no_grad()
    def _inputs(self, data: Transitions) -> tuple[Tensor, Tensor]:
        """Normalised (o, a, h), and the change that followed."""
        x, _, change = self.tensors(data)
        return torch.cat([x, self.hidden(torch.tensor(data.hidden))], dim=1), change
