"""MeanShiftOT: translation without a GAN, in closed form on top of two regressors."""

from __future__ import annotations

import numpy as np
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

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress both domains' changes, then match their residuals' covariances."""
        steps = self.settings.steps
        first = progress and (lambda k, _: progress(k, 2 * steps))
        self.mean_sim, residual_sim = self._domain(sim, first)
        second = progress and (lambda k, _: progress(steps + k, 2 * steps))
        self.mean_real, residual_real = self._domain(real, second)
        self.map = gaussian_transport(residual_sim, residual_real)

    def predict(self, pairs: Pairs) -> np.ndarray:
        """R's mean plus S's moved residual."""
        x, _, _ = self.tensors(pairs.real)
        residual = self.sim_change(pairs) - in_chunks(self.mean_sim, x)
        return self.states(pairs, in_chunks(self.mean_real, x) + residual @ self.map)

    def _domain(self, data: Transitions, progress: Progress | None) -> tuple[nn.Module, Tensor]:
        x, _, change = self.tensors(data)
        net = self.network(x.shape[1])
        regress(
            net, lambda rows: net(x[rows]) - change[rows], len(x), self.budget(), progress=progress
        )
        return net, change - in_chunks(net, x)
