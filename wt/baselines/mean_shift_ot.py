"""MeanShiftOT: translation without a GAN, in closed form on top of two regressors."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from wt.baselines.base import Baseline, in_chunks, register
from wt.train.mean_field import gaussian_transport
from wt.train.regression import Progress, regress
from wt.types import Pairs, Transitions


@register
class MeanShiftOT(Baseline):
    """o′ = o + m_R(o, a) + T (o′_S − o − m_S(o, a)), T the Gaussian optimal transport.

    m_S and m_R are least-squares regressors, each on its own domain's transitions, and T moves
    the covariance of S's residuals to that of R's.
    """

    name = "MeanShiftOT"

    def build(self) -> dict[str, nn.Module]:
        """The regressors m_S and m_R, and T."""
        self.mean_sim, self.mean_real = (self.network(self.frame.n_condition) for _ in range(2))
        self.map = nn.Linear(self.spec.n_state, self.spec.n_state, bias=False)
        return {"mean_sim": self.mean_sim, "mean_real": self.mean_real, "map": self.map}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress both domains' changes, then match their residuals' covariances."""
        steps = self.settings.steps
        first = progress and (lambda k, _: progress(k, 2 * steps))
        residual_sim = self._residual(self.mean_sim, sim, first)
        second = progress and (lambda k, _: progress(steps + k, 2 * steps))
        residual_real = self._residual(self.mean_real, real, second)
        with torch.no_grad():
            self.map.weight.copy_(gaussian_transport(residual_sim, residual_real).T)

    @torch.no_grad()
    def predict(self, pairs: Pairs) -> np.ndarray:
        """R's mean plus S's moved residual."""
        x, _, _ = self.tensors(pairs.real)
        residual = self.sim_change(pairs) - in_chunks(self.mean_sim, x)
        return self.states(pairs, in_chunks(self.mean_real, x) + self.map(residual))

    def _residual(self, net: nn.Module, data: Transitions, progress: Progress | None) -> Tensor:
        """Train a domain's regressor, and return what it leaves of the domain's changes."""
        x, _, change = self.tensors(data)
        regress(
            net, lambda rows: net(x[rows]) - change[rows], len(x), self.budget(), progress=progress
        )
        return change - in_chunks(net, x)
