"""SimulatorEncoder: S itself encodes what is hidden, and a regressor decodes R's outcome.

What World Translation's encoder learns to say of a transition a simulator says by itself, once it
is told the hidden variable. R's is estimated from R's own recording (:mod:`wt.train.hidden`). S,
set to that estimate, answers R's (o, a); and with the answer as a further input, R's outcome is
plain regression on R's transitions. No adversary, no pairs, and nothing that a task sets apart.

In use the simulator runs with its own hidden state, as under the paper's translation: the input is
its own answer.
"""

from __future__ import annotations

from torch import nn

from wt.baselines._corrected import CorrectedAnswer
from wt.baselines.base import register
from wt.nets.mlp import mlp
from wt.train.hidden import HiddenEstimator
from wt.train.regression import Progress, part_of
from wt.types import Pairs, Transitions, TransitionSpec


@register
class SimulatorEncoder(CorrectedAnswer):
    """o′ = o′_S(ĥ) + f(o, a, o′_S(ĥ)), ĥ estimated from R's recording; in use S's own answer."""

    name = "SimulatorEncoder"

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """What it is given."""
        return "steps the simulator again, at estimates of what was hidden in R's recording."

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Estimate what was hidden, let S answer, and regress what R does differently."""
        self._estimator = HiddenEstimator(self.frame, self._regressor, self.budget())
        steps = self.settings.steps
        before = self._estimator.regressions * steps
        total = before + self.settings.members * steps
        self._estimator.fit(sim, real, part_of(progress, 0, total))
        self.correct(real, part_of(progress, before, total))

    def answered(self, real: Transitions) -> Pairs:
        """R's transitions, each with S's answer at the estimate of what was hidden."""
        answered = self._estimator.answered(real, self.the_simulator())
        return Pairs(real, answered.nominal)

    def _regressor(self, inputs: int, outputs: int) -> nn.Module:
        """A network of the shared size."""
        return mlp(inputs, outputs, self.settings.width, self.settings.depth)
