"""S's answer, corrected by a regression that reads it: the part that several baselines share."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline
from wt.nets.mlp import in_chunks
from wt.train.regression import Progress
from wt.train.selection import Paired, Selection
from wt.types import Pairs, Transitions


class CorrectedAnswer(Baseline):
    """o′ = o′_S + f(o, a, o′_S), least squares; subclasses say under what S answers in training."""

    @abstractmethod
    def answered(self, real: Transitions) -> Pairs:
        """R's transitions, each with the answer of S that f is trained on."""

    def build(self) -> dict[str, nn.Module]:
        """The network f, or several, averaged."""
        self.net = self.ensemble(self.frame.n_condition + self.spec.n_state)
        return {"net": self.net}

    def correct(self, answered: Pairs, progress: Progress | None) -> None:
        """Regress what R does differently from S's answers."""
        inputs, answer = self._inputs(answered)
        change = self.tensors(answered.real)[2]
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
        """Pairs; where selection has none, what is held out, answered as it is trained on."""
        if isinstance(selection, Paired):
            return selection.predicted
        return self.answered(selection.predicted.real)

    @torch.no_grad()
    def _inputs(self, pairs: Pairs) -> tuple[Tensor, Tensor]:
        """Normalised (o, a, o′_S), and S's change."""
        x, _, _ = self.tensors(pairs.real)
        answer = self.sim_change(pairs)
        return torch.cat([x, answer], dim=1), answer
