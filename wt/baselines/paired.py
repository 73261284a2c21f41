"""PairedCeiling: what is possible with what a translation is given, if there were pairs.

It reads what a translation reads, S's answer under the true hidden variable, and is trained on
pairs: R's transitions, each with that answer. Nobody has these of a real robot with something
hidden. So it is no rival, and stands in tables as what the rest can at best come near to.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, in_chunks, register
from wt.train.regression import Progress
from wt.train.selection import Paired, Selection
from wt.types import Pairs, Transitions, TransitionSpec


@register
class PairedCeiling(Baseline):
    """o′ = o′_S + f(o, a, o′_S), least squares on pairs."""

    name = "PairedCeiling"

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """That it is no rival."""
        return "trained on pairs of S and R, which the others have not: what is possible, no rival."

    def build(self) -> dict[str, nn.Module]:
        """The network f, or several, averaged."""
        self.net = self.ensemble(self.frame.n_condition + self.spec.n_state)
        return {"net": self.net}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress what R does differently from S's answer under the true hidden variable."""
        pairs = Pairs(real, self.the_simulator().answers(real))
        inputs, answer = self._inputs(pairs)
        change = self.tensors(real)[2]
        self.fit_ensemble(
            self.net,
            lambda rows: answer[rows] + self.net(inputs[rows]) - change[rows],
            len(inputs),
            progress,
        )

    def predict(self, pairs: Pairs) -> np.ndarray:
        """S's answer, corrected."""
        inputs, answer = self._inputs(pairs)
        return self.states(pairs, answer + in_chunks(self.net, inputs))

    def held_out(self, selection: Selection) -> Pairs:
        """Pairs, as it is trained on: made of what is held out where that has none."""
        if isinstance(selection, Paired):
            return selection.predicted
        real = selection.predicted.real
        return Pairs(real, self.the_simulator().answers(real))

    @torch.no_grad()
    def _inputs(self, pairs: Pairs) -> tuple[Tensor, Tensor]:
        """Normalised (o, a, o′_S), and S's change."""
        x, _, _ = self.tensors(pairs.real)
        answer = self.sim_change(pairs)
        return torch.cat([x, answer], dim=1), answer
