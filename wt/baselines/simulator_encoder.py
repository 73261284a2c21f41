"""SimulatorEncoder: S itself encodes what is hidden, and a regressor decodes R's outcome.

What World Translation's encoder learns to say of a transition a simulator says by itself, once it
is told the hidden variable. R's is estimated from R's own recording (:mod:`wt.train.hidden`). S,
set to that estimate, answers R's (o, a); and with the answer as a further input, R's outcome is
plain regression on R's transitions. No adversary, no pairs, and nothing that a task sets apart.

In use the simulator runs with its own hidden state, as under the paper's translation: the input is
its own answer.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, in_chunks, register
from wt.nets.mlp import mlp
from wt.train.hidden import HiddenEstimator
from wt.train.regression import Progress, part_of
from wt.train.selection import Paired, Selection
from wt.types import Pairs, Transitions, TransitionSpec


@register
class SimulatorEncoder(Baseline):
    """o′ = o′_S(ĥ) + f(o, a, o′_S(ĥ)), ĥ estimated from R's recording; in use S's own answer."""

    name = "SimulatorEncoder"

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """What it is given."""
        return "steps the simulator again, at estimates of what was hidden in R's recording."

    def build(self) -> dict[str, nn.Module]:
        """The network f, or several, averaged."""
        self.net = self.ensemble(self.frame.n_condition + self.spec.n_state)
        return {"net": self.net}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Estimate what was hidden, let S answer, and regress what R does differently."""
        self._estimator = HiddenEstimator(self.frame, self._regressor, self.budget())
        steps = self.settings.steps
        before = self._estimator.regressions * steps
        total = before + self.settings.members * steps
        self._estimator.fit(sim, real, part_of(progress, 0, total))
        pairs = self._answered(real)
        inputs, answer = self._inputs(pairs)
        change = self.tensors(real)[2]
        self.fit_ensemble(
            self.net,
            lambda rows: answer[rows] + self.net(inputs[rows]) - change[rows],
            len(inputs),
            part_of(progress, before, total),
        )

    def predict(self, pairs: Pairs) -> np.ndarray:
        """S's answer, corrected."""
        inputs, answer = self._inputs(pairs)
        return self.states(pairs, answer + in_chunks(self.net, inputs))

    def held_out(self, selection: Selection) -> Pairs:
        """R's held-out transitions, with S's answers at estimates where there are no pairs."""
        if isinstance(selection, Paired):
            return selection.predicted
        return self._answered(selection.predicted.real)

    def _answered(self, real: Transitions) -> Pairs:
        """R's transitions, each with S's answer at the estimate of what was hidden."""
        answered = self._estimator.answered(real, self.the_simulator())
        return Pairs(real, answered.nominal)

    def _regressor(self, inputs: int, outputs: int) -> nn.Module:
        """A network of the shared size."""
        return mlp(inputs, outputs, self.settings.width, self.settings.depth)

    @torch.no_grad()
    def _inputs(self, pairs: Pairs) -> tuple[Tensor, Tensor]:
        """Normalised (o, a, o′_S), and S's change."""
        x, _, _ = self.tensors(pairs.real)
        answer = self.sim_change(pairs)
        return torch.cat([x, answer], dim=1), answer
