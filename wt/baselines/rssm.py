"""RSSM: a recurrent state-space model that infers what is hidden from the past.

The deterministic path h_t is a GRU over (o, a) and the latent of the step before; the stochastic
latent z_t of a step has a prior p(z_t | h_t) and, once the step's outcome is known, a posterior
q(z_t | h_t, o′). Filtering runs the posterior over the history; the prediction for the present
step decodes its prior. Hafner et al., "Learning latent dynamics for planning from pixels" (2019)
and, for the balanced KL, "Mastering Atari with discrete world models" (2020).

What (o, a) alone tells is decoded by a network of its own, DirectPred's, which learns from as many
single transitions a step as the other baselines do; h and z decode what it leaves. Windows of
consecutive transitions resemble one another: half as wide and on windows alone, it made 2.9 times
DirectPred's error on an R5 of which nothing is hidden, so 0.94 times.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from wt.baselines.base import Baseline, register
from wt.data.history import History
from wt.nets.mlp import mlp
from wt.train.device import seeded
from wt.train.regression import Progress, regress
from wt.types import Pairs, Transitions

LATENT = 16
KL_WEIGHT = 0.1
KL_BALANCE = 0.8  # share of the KL that trains the prior
SMALLEST_STD = 0.05
CHUNK = 4096
EVERY = 4
"""The cell learns at one in so many steps, from so many times the windows: on R5 Force that took a
quarter less time than at every step, to the same error."""


class _Cell(nn.Module):
    """One step of the state-space model."""

    def __init__(self, condition: int, state: int, width: int) -> None:
        super().__init__()
        self.width = width
        self.gru = nn.GRUCell(condition + LATENT, width)
        self.prior = mlp(width, 2 * LATENT, width, 1)
        self.posterior = mlp(width + state, 2 * LATENT, width, 1)
        self.decoder = mlp(width, state, width, 1, zero_last=True)
        self.from_path = nn.Linear(width + condition, width)
        self.from_latent = nn.Linear(LATENT, width, bias=False)

    def gaussian(self, net: nn.Module, inputs: Tensor) -> tuple[Tensor, Tensor]:
        mean, raw = net(inputs).chunk(2, dim=-1)
        return mean, nn.functional.softplus(raw) + SMALLEST_STD

    def decode(self, h: Tensor, latents: Sequence[Tensor], x: Tensor) -> list[Tensor]:
        """What several latents say of the same steps; the rest of the first layer is shared."""
        shared = self.from_path(torch.cat([h, x], dim=-1))
        act = nn.functional.silu
        return [self.decoder(act(shared + self.from_latent(z))) for z in latents]


def _kl(q: tuple[Tensor, Tensor], p: tuple[Tensor, Tensor]) -> Tensor:
    # log(σ_p / σ_q) + (σ_q² + (μ_q − μ_p)²) / (2 σ_p²) − ½
    (mean_q, std_q), (mean_p, std_p) = q, p
    ratio = (std_q**2 + (mean_q - mean_p) ** 2) / (2 * std_p**2)
    return (torch.log(std_p / std_q) + ratio - 0.5).sum(-1)


@register
class RSSM(Baseline):
    """o′ = o + f(o, a) + D(h, E[z | h], o, a), h and z filtered over the history."""

    name = "RSSM"
    cost = 7.0

    def build(self) -> dict[str, nn.Module]:
        """The network f, and the cell."""
        self.direct = self.network(self.frame.n_condition)
        self.cell = _Cell(self.frame.n_condition, self.spec.n_state, self.settings.width)
        return {"direct": self.direct, "cell": self.cell}

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Train f on single transitions of R, and the cell on windows that hold as many in all."""
        x, _, change = self.tensors(real)
        history = History(real, self.settings.history)
        cell, direct, noise, budget = self.cell, self.direct, seeded(self.seed), self.budget()
        windows, steps = max(1, EVERY * budget.batch // (history.length + 1)), itertools.count()

        def loss(rows: Tensor) -> Tensor:
            alone = ((direct(x[rows]) - change[rows]) ** 2).mean()
            if next(steps) % EVERY:
                return alone
            last = rows[:windows]
            index, exists = history.before(last)
            index = torch.cat([index, last[:, None]], dim=1)
            exists = torch.cat([exists, torch.ones(len(last), 1, dtype=torch.bool)], dim=1)
            now, went = x[index], change[index]
            with torch.no_grad():
                told = direct(now)
            return alone + _elbo_terms(cell, now, went, told, exists, noise).mean()

        nets = nn.ModuleList([direct, cell])
        regress(nets, loss, len(x), budget, lambda value, _: value, progress, self.score())

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
            parts.append(self.direct(x[rows]) + cell.decode(h, [prior], x[rows])[0])
        return self.states(pairs, torch.cat(parts))


def _elbo_terms(
    cell: _Cell,
    x: Float[Tensor, "batch time condition"],
    change: Float[Tensor, "batch time state"],
    told: Float[Tensor, "batch time state"],
    exists: Bool[Tensor, "batch time"],
    noise: torch.Generator,
) -> Float[Tensor, " batch"]:
    """Reconstruction, prediction from the prior's mean, and balanced KL, per window.

    Args:
        cell: the model.
        x: normalised (o, a).
        change: normalised change that followed.
        told: what (o, a) alone tells of it.
        exists: False before an episode began.
        noise: of the posterior's samples.
    """
    batch, steps = x.shape[:2]
    h, z = x.new_zeros(batch, cell.width), x.new_zeros(batch, LATENT)
    path: list[tuple[Tensor, ...]] = []
    for k in range(steps):
        h_new = cell.gru(torch.cat([x[:, k], z], dim=-1), h)
        mean, std = cell.gaussian(cell.posterior, torch.cat([h_new, change[:, k]], dim=-1))
        z_new = mean + std * torch.randn(batch, LATENT, generator=noise)
        path.append((h_new, z_new, mean, std))
        mask = exists[:, k, None]
        h, z = torch.where(mask, h_new, h), torch.where(mask, z_new, z)
    # what feeds nothing back is done for all steps at once
    h_all, z_all, *posterior = (torch.stack(part, dim=1) for part in zip(*path, strict=True))
    prior = cell.gaussian(cell.prior, h_all)
    left = change - told
    rebuilt, predicted = ((out - left) ** 2 for out in cell.decode(h_all, (z_all, prior[0]), x))
    q = posterior[0], posterior[1]
    kl = KL_BALANCE * _kl(_detached(q), prior) + (1 - KL_BALANCE) * _kl(q, _detached(prior))
    terms = rebuilt.mean(-1) + predicted.mean(-1) + KL_WEIGHT * kl / change.shape[-1]
    return (terms * exists).sum(-1) / exists.sum(-1)


def _detached(gaussian: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return gaussian[0].detach(), gaussian[1].detach()
