"""SimulatorEncoder: S itself encodes what is hidden, and a regressor decodes R's outcome.

What World Translation's encoder learns to say of a transition a simulator says by itself, once it
is told the hidden variable. R's is estimated from R's own recording (:mod:`wt.train.hidden`). S,
set to that estimate, answers R's (o, a); that is made into what it would have answered in use
(:mod:`wt.train.answers`), and with the answer as a further input, R's outcome is plain regression
on R's transitions. No adversary, no pairs, and nothing that a task sets apart.

In use the simulator runs with its own hidden state, as under the paper's translation: the input is
its own answer.
"""

from __future__ import annotations

from torch import nn

from wt.baselines._corrected import CorrectedAnswer
from wt.baselines.base import register
from wt.nets.mlp import mlp
from wt.train.answers import Answers
from wt.train.regression import Progress, part_of
from wt.types import Pairs, Transitions, TransitionSpec


@register
class SimulatorEncoder(CorrectedAnswer):
    """o′ = o′_S + f(o, a, o′_S); S's answers in training are made from R's recording alone."""

    name = "SimulatorEncoder"
    trains_on = ("sim", "real", "lessons")
    cost = 4.0

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """What it is given."""
        return "steps the simulator again, at estimates of what was hidden in R's recording."

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Make what S would have answered, and regress what R does differently."""
        given = self.budget(), self.the_simulator(), self.lessons
        answers = Answers(self.frame, self._regressor, *given)
        steps = self.settings.steps
        before = answers.regressions * steps
        total = before + self.settings.members * steps
        answered = answers.fit(sim, real, part_of(progress, 0, total))
        self._answers = answers
        self.correct(Pairs(real, answered.nominal), part_of(progress, before, total))

    def answered(self, real: Transitions) -> Pairs:
        """R's transitions, each with what S would have answered."""
        return Pairs(real, self._answers.of(real).nominal)

    def _regressor(self, inputs: int, outputs: int) -> nn.Module:
        """A network of the shared size."""
        return mlp(inputs, outputs, self.settings.width, self.settings.depth)
