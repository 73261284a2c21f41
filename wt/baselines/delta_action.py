"""DeltaAction: a network that corrects the action given to S so that S's answer is R's.

As ASAP's delta-action model (He et al. 2025) and unsupervised actuator nets (Fey et al. 2025),
which are trained by reinforcement along R's trajectories; grounded action transformation (Hanna
and Stone 2017) is their ancestor. Single steps allow plain regression instead: S's answer as a
function of the action is imitated by a network, and the correction is trained through it.

No pairs are needed, but it assumes more than a translation does. S must be stepped again, in use
and before it: set to R's own observations, under other actions, with nothing hidden. And what R
does differently must be something that another action can bring about in one step.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, register
from wt.nets.mlp import in_chunks, mlp
from wt.train.regression import Progress, Score, part_of, regress
from wt.train.selection import Unpaired
from wt.types import Pairs, Transitions, TransitionSpec

REACH = 1.0
"""Largest correction, in standard deviations of the action."""
RETAKEN = 100_000
"""Most steps of R that S is made to take again under other actions."""


@register
class DeltaAction(Baseline):
    """o′ = S(o, a + δ(o, a)), S given what is hidden; δ by least squares on R, S imitated."""

    name = "DeltaAction"

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """What it is given."""
        return "steps the simulator again, under the actions that it corrects."

    def build(self) -> dict[str, nn.Module]:
        """The correction δ, from none on; the imitation of S is not needed once it is trained."""
        size = self.frame.n_condition, self.spec.n_action, self.settings.width, self.settings.depth
        self.delta = mlp(*size, zero_last=True)
        self.imitation = self.network(self.frame.n_condition)
        return {"delta": self.delta, "imitation": self.imitation}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Imitate S under R's actions and others, then correct R's through the imitation."""
        steps = self.settings.steps
        x, nominal, change = self.tensors(real)
        self._imitate(x, nominal, real, part_of(progress, 0, 2 * steps))
        self.imitation.requires_grad_(False)

        def error(rows: Tensor) -> Tensor:
            return self.imitation(self._corrected(x[rows])) - change[rows]

        second = part_of(progress, steps, 2 * steps)
        regress(self.delta, error, len(x), self.budget(), progress=second, score=self.score())

    @torch.no_grad()
    def predict(self, pairs: Pairs) -> np.ndarray:
        """S's answer to the corrected action, under what is hidden."""
        real = pairs.real
        o, a = torch.tensor(real.o), torch.tensor(real.a)
        x = self.frame.conditions(o, a)
        corrected = a + self._scale() * REACH * torch.tanh(in_chunks(self.delta, x))
        return self.the_simulator().sim_step(real.o, corrected.cpu().numpy(), real.hidden)

    def score(self) -> Score | None:
        """Error on what is held out; of the imitation where S's own answer needs what is hidden."""
        if not isinstance(self.selection, Unpaired):
            return super().score()
        x, _, change = self.tensors(self.selection.predicted.real)

        @torch.no_grad()
        def measured() -> float:
            answer = in_chunks(lambda rows: self.imitation(self._corrected(rows)), x)
            return float(((answer - change) ** 2).mean())

        return self.drawn("mse", measured)

    def _imitate(
        self, x: Tensor, nominal: Tensor, real: Transitions, progress: Progress | None
    ) -> None:
        """Regress S's change with nothing hidden on (o, a), for a of R and for others nearby."""
        draw = np.random.default_rng(self.seed)
        some = np.sort(draw.permutation(len(real))[:RETAKEN])
        o, a = real.o[some], real.a[some]
        away = draw.uniform(-1.0, 1.0, a.shape) * REACH * self._scale().cpu().numpy()
        other = (a + away).astype(np.float32)
        answer = self.the_simulator().sim_step(o, other, None)
        seen = torch.tensor(o)
        with torch.no_grad():
            inputs = torch.cat([x, self.frame.conditions(seen, torch.tensor(other))])
            target = torch.cat([nominal, self.frame.changes(seen, torch.tensor(answer))])
        regress(
            self.imitation,
            lambda rows: self.imitation(inputs[rows]) - target[rows],
            len(inputs),
            self.budget(),
            progress=progress,
        )

    def _scale(self) -> Tensor:
        """Standard deviation of the actions as networks see them, physical units."""
        return self.frame.condition.std[-self.spec.n_action :]

    def _corrected(self, x: Tensor) -> Tensor:
        """Normalised (o, a + δ(o, a)): one standard deviation of the action is one there."""
        n = self.spec.n_action
        return torch.cat([x[:, :-n], x[:, -n:] + REACH * torch.tanh(self.delta(x))], dim=1)
