"""RSSM: a recurrent state-space model that infers what is hidden from the past.

The deterministic path h_t is a GRU over (o, a) and the latent of the step before; the stochastic
latent z_t of a step has a prior p(z_t | h_t) and, once the step's outcome is known, a posterior
q(z_t | h_t, o′). Filtering runs the posterior over the history; the prediction for the present
step decodes its prior. Hafner et al., "Learning latent dynamics for planning from pixels" (2019)
and, for the balanced KL, "Mastering Atari with discrete world models" (2020).
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from wt.baselines.base import Baseline, register
from wt.data.history import History
from wt.nets.mlp import mlp
from wt.train.device import seeded
from wt.train.regression import Progress, Regression, regress
from wt.types import Pairs, Transitions

LATENT = 16
KL_WEIGHT = 0.1
KL_BALANCE = 0.8  # share of the KL that trains the prior
SMALLEST_STD = 0.05
CHUNK = 4096


class _Cell(nn.Module):
    """One step of the state-space model."""

    def __init__(self, condition: int, state: int, width: int) -> None:
        super().__init__()
        self.width = width
        self.gru = nn.GRUCell(condition + LATENT, width)
        self.prior = mlp(width, 2 * LATENT, width, 1)
        self.posterior = mlp(width + state, 2 * LATENT, width, 1)
        self.decoder = mlp(width + LATENT + condition, state, width, 2)

    def gaussian(self, net: nn.Module, inputs: Tensor) -> tuple[Tensor, Tensor]:
        mean, raw = net(inputs).chunk(2, dim=-1)
        return mean, nn.functional.softplus(raw) + SMALLEST_STD

    def decode(self, h: Tensor, z: Tensor, x: Tensor) -> Tensor:
        return self.decoder(torch.cat([h, z, x], dim=-1))


def _kl(q: tuple[Tensor, Tensor], p: tuple[Tensor, Tensor]) -> Tensor:
    # log(σ_p / σ_q) + (σ_q² + (μ_q − μ_p)²) / (2 σ_p²) − ½
    (mean_q, std_q), (mean_p, std_p) = q, p
    ratio = (std_q**2 + (mean_q - mean_p) ** 2) / (2 * std_p**2)
    return (torch.log(std_p / std_q) + ratio - 0.5).sum(-1)


@register
class RSSM(Baseline):
    """o′ = o + D(h, E[z | h], o, a), h and z filtered over the history."""

    name = "RSSM"

    def build(self) -> dict[str, nn.Module]:
        """The cell; half as wide, since it consists of several networks."""
        self.cell = _Cell(self.frame.n_condition, self.spec.n_state, self.settings.width // 2)
        return {"cell": self.cell}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Train on windows of R."""
        x, _, change = self.tensors(real)
        history = History(real, self.settings.history)
        cell = self.cell
        noise = seeded(self.seed)
        budget = self.budget()
        # a window holds history + 1 transitions: same number of transitions per step as others
        batch = max(1, budget.batch // (history.length + 1))
        budget = Regression(budget.steps, batch, budget.learning_rate / 2, self.seed)

        def error(rows: Tensor) -> Tensor:
            index, exists = history.before(rows)
            index = torch.cat([index, rows[:, None]], dim=1)
            exists = torch.cat([exists, torch.ones(len(rows), 1, dtype=torch.bool)], dim=1)
            return _elbo_terms(cell, x[index], change[index], exists, noise)

        # the terms already are the loss: their mean is minimised
        regress(cell, error, len(x), budget, lambda terms, _: terms.mean(), progress, self.score())

    @torch.no_grad()
    def predict(self, pairs: Pairs) -> np.ndarray:
        """Filter over the history with the posterior's mean, then decode the prior's."""
        x, _, change = self.tensors(pairs.real)
        history = History(pairs.real, self.settings.history)
        cell, parts = self.cell, []
        for rows in torch.arange(len(x)).split(CHUNK):
            index, exists = history.before(rows)
            h = x.new_zeros(len(rows), cell.width)
            z = x.new_zeros(len(rows), LATENT)
            for k in range(history.length):
                now, mask = x[index[:, k]], exists[:, k, None]
                h_new = cell.gru(torch.cat([now, z], dim=-1), h)
                seen = torch.cat([h_new, change[index[:, k]]], dim=-1)
                z_new, _ = cell.gaussian(cell.posterior, seen)
                h, z = torch.where(mask, h_new, h), torch.where(mask, z_new, z)
            h = cell.gru(torch.cat([x[rows], z], dim=-1), h)
            prior, _ = cell.gaussian(cell.prior, h)
            parts.append(cell.decode(h, prior, x[rows]))
        return self.states(pairs, torch.cat(parts))


def _elbo_terms(
    cell: _Cell,
    x: Float[Tensor, "batch time condition"],
    change: Float[Tensor, "batch time state"],
    exists: Bool[Tensor, "batch time"],
    noise: torch.Generator,
) -> Float[Tensor, " batch"]:
    """Reconstruction, prediction from the prior's mean, and balanced KL, per window."""
    batch, steps = x.shape[:2]
    h, z = x.new_zeros(batch, cell.width), x.new_zeros(batch, LATENT)
    total = x.new_zeros(batch)
    for k in range(steps):
        h_new = cell.gru(torch.cat([x[:, k], z], dim=-1), h)
        prior = cell.gaussian(cell.prior, h_new)
        posterior = cell.gaussian(cell.posterior, torch.cat([h_new, change[:, k]], dim=-1))
        z_new = posterior[0] + posterior[1] * torch.randn(batch, LATENT, generator=noise)
        rebuilt = (cell.decode(h_new, z_new, x[:, k]) - change[:, k]) ** 2
        predicted = (cell.decode(h_new, prior[0], x[:, k]) - change[:, k]) ** 2
        still_prior, still_posterior = _detached(prior), _detached(posterior)
        kl = KL_BALANCE * _kl(still_posterior, prior)
        kl = kl + (1 - KL_BALANCE) * _kl(posterior, still_prior)
        terms = rebuilt.mean(-1) + predicted.mean(-1) + KL_WEIGHT * kl / change.shape[-1]
        mask = exists[:, k]
        total = total + terms * mask
        h = torch.where(mask[:, None], h_new, h)
        z = torch.where(mask[:, None], z_new, z)
    return total / exists.sum(-1)


def _detached(gaussian: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return gaussian[0].detach(), gaussian[1].detach()
