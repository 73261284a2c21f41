"""ResDyn: the simulator's output plus a correction learned from history.

The paper's sees history only: its simulator runs with nothing hidden, since in reality nobody
knows what is. On legs it therefore lacks what RawSim and the translations are given, the trunk's
velocity above all. ``ResDynSim`` is the stronger reading, in which the correction also sees the
simulator's output, and that simulator is given the true hidden variable when it is evaluated.
While training on R it cannot be, so its network learns from the nominal simulator: this is the
handicap of every residual method without pairs.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, register
from wt.data.history import History
from wt.nets.mlp import CHUNK
from wt.train.regression import Progress
from wt.types import Pairs, Transitions, TransitionSpec


@register
class ResDyn(Baseline):
    """o′ = o′_nominal + δ(history, o, a), least squares on R."""

    name = "ResDyn"
    reads_simulator = False

    @classmethod
    def remark(cls, spec: TransitionSpec) -> str | None:
        """What its simulator lacks that the others' has."""
        if not spec.hidden or cls.reads_simulator:
            return None
        return (
            "its simulator lacks what is hidden, which RawSim's and the translations' is given; "
            "ResDynSim's is given it too."
        )

    def build(self) -> dict[str, nn.Module]:
        """The network δ, or several, averaged."""
        x, n = self.frame.n_condition, self.spec.n_state
        past = x if self.reads_simulator else x + n
        self.net = self.ensemble(x + self.settings.history * past + n * self.reads_simulator)
        return {"net": self.net}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress R's difference from the nominal simulator."""
        x, nominal, change = self.tensors(real)
        past, history = self._past(x, change), History(real, self.settings.history)

        def error(rows: Tensor) -> Tensor:
            inputs = self._inputs(x, past, history, rows, nominal)
            return nominal[rows] + self.net(inputs) - change[rows]

        self.fit_ensemble(self.net, error, len(x), progress)

    @torch.no_grad()
    def predict(self, pairs: Pairs) -> np.ndarray:
        """Corrected output of the simulator."""
        x, nominal, change = self.tensors(pairs.real)
        base = self.sim_change(pairs) if self.reads_simulator else nominal
        past, history = self._past(x, change), History(pairs.real, self.settings.history)
        predicted = [
            base[rows] + self.net(self._inputs(x, past, history, rows, base))
            for rows in torch.arange(len(x)).split(CHUNK)
        ]
        return self.states(pairs, torch.cat(predicted))

    def _past(self, x: Tensor, change: Tensor) -> Tensor:
        """Memory of a step: (o, a), and the change that followed.

        The change can be had from the next observation, but is small beside the workspace;
        the network that reads the simulator does better without it.
        """
        return x if self.reads_simulator else torch.cat([x, change], dim=1)

    def _inputs(
        self, x: Tensor, past: Tensor, history: History, rows: Tensor, base: Tensor
    ) -> Tensor:
        index, exists = history.before(rows)
        parts = [(past[index] * exists[..., None]).flatten(1), x[rows]]
        return torch.cat([*parts, base[rows]] if self.reads_simulator else parts, dim=1)


@register
class ResDynSim(ResDyn):
    """o′ = o′_S + δ(history, o, a, o′_S), with S given the true hidden variable."""

    name = "ResDynSim"
    reads_simulator = True
