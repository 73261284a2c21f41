"""PairedCeiling: what is possible with what a translation is given, if there were pairs.

It reads what a translation reads, S's answer under the true hidden variable, and is trained on
pairs: R's transitions, each with that answer. Nobody has these of a real robot with something
hidden. So it is no rival, and stands in tables as what the rest can at best come near to.
"""

from __future__ import annotations

from wt.baselines._corrected import CorrectedAnswer
from wt.baselines.base import register
from wt.train.regression import Progress
from wt.types import Pairs, Transitions, TransitionSpec


@register
class PairedCeiling(CorrectedAnswer):
    """o′ = o′_S + f(o, a, o′_S), least squares on pairs."""

    name = "PairedCeiling"
    trains_on = ("pairs",)

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """That it is no rival."""
        return "trained on pairs of S and R, which the others have not: what is possible, no rival."

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress what R does differently from S's answer under the true hidden variable."""
        self.correct(self.answered(real), progress)

    def answered(self, real: Transitions) -> Pairs:
        """Pairs: S's answers under the true hidden variable."""
        return Pairs(real, self.the_simulator().answers(real))
