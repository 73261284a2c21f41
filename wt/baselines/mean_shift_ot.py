"""MeanShiftOT: translation without a GAN, in closed form on top of two regressors."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, register
from wt.nets.mlp import in_chunks
from wt.train.mean_field import gaussian_transport
from wt.train.regression import Progress, Score, regress
from wt.types import Pairs, Transitions

LOOKED_AT = 20_000
"""Transitions of each domain that T is fitted to each time that it is scored."""


@register
class MeanShiftOT(Baseline):
    """o′ = o + m_R(o, a) + T (o′_S − o − m_S(o, a)), T the Gaussian optimal transport.

    m_S and m_R are least-squares regressors, each on its own domain's transitions, and T moves
    the covariance of S's residuals to that of R's. Both are trained side by side, and taken at the
    step at which all three together score best on what is held out.
    """

    name = "MeanShiftOT"
    trains_on = ("sim", "real")
    translates = True

    def build(self) -> dict[str, nn.Module]:
        """The regressors m_S and m_R, and T."""
        self.means = nn.ModuleList([self.network(self.frame.n_condition) for _ in range(2)])
        self.map = nn.Linear(self.spec.n_state, self.spec.n_state, bias=False)
        return {"means": self.means, "map": self.map}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress both domains' changes, then match their residuals' covariances."""
        domains = [(x, change) for x, _, change in (self.tensors(sim), self.tensors(real))]

        def error(rows: Tensor) -> Tensor:
            # the same draw for both: the domains are unpaired, and either may be the smaller
            parts = zip(self.means, domains, strict=True)
            return torch.cat([_left(net, x, change, rows % len(x)) for net, (x, change) in parts])

        score = self.score()
        some = [(x[:: _every(x)], change[:: _every(x)]) for x, change in domains]

        def with_map() -> float:
            self._fit_map(some)
            return score() if score else 0.0

        rows = max(len(x) for x, _ in domains)
        looked: Score | None = with_map if score else None
        regress(self.means, error, rows, self.budget(), progress=progress, score=looked)
        self._fit_map(domains)

    @torch.no_grad()
    def predict(self, pairs: Pairs) -> np.ndarray:
        """R's mean plus S's moved residual."""
        x, _, _ = self.tensors(pairs.real)
        of_sim, of_real = (in_chunks(net, x) for net in self.means)
        return self.states(pairs, of_real + self.map(self.sim_change(pairs) - of_sim))

    @torch.no_grad()
    def _fit_map(self, domains: list[tuple[Tensor, Tensor]]) -> None:
        """Fit T to what the regressors leave of both domains' changes."""
        left = [
            change - in_chunks(net, x) for net, (x, change) in zip(self.means, domains, strict=True)
        ]
        self.map.weight.copy_(gaussian_transport(*left).T)


def _every(x: Tensor) -> int:
    return max(1, len(x) // LOOKED_AT)


def _left(net: nn.Module, x: Tensor, change: Tensor, rows: Tensor) -> Tensor:
    residual: Tensor = net(x[rows]) - change[rows]
    return residual
