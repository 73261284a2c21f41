"""Supervised regression on tensors in memory: the mean field's and the baselines' one loop."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from wt.train.device import seeded

Loss = Callable[[Tensor, float], Tensor]
"""(error of a batch (batch, channels), progress 0…1) → scalar loss."""

Progress = Callable[[int, int], None]

Score = Callable[[], float]
"""Error of the network as it is now, on pairs that it is not trained on."""

LOOKS = 10
"""Number of times that the score is taken during training."""


@dataclass(frozen=True)
class Regression:
    """Budget of one regression.

    Attributes:
        steps: optimizer steps.
        batch: rows per step.
        learning_rate: its peak; it rises over the first tenth and falls along a cosine to zero.
        seed: same seed, same batches.
        weight_decay: of AdamW.
    """

    steps: int
    batch: int
    learning_rate: float
    seed: int = 0
    weight_decay: float = 1e-4

    def rate(self, step: int) -> float:
        """Learning rate at a step."""
        progress = step / self.steps
        warm = min(1.0, (step + 1) / max(1.0, 0.1 * self.steps))
        return self.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * progress))


def mean_square(error: Tensor, progress: float) -> Tensor:
    """Least squares."""
    return (error**2).mean()


def regress(
    net: nn.Module,
    batch_error: Callable[[Tensor], Tensor],
    rows: int,
    settings: Regression,
    loss: Loss = mean_square,
    progress: Progress | None = None,
    score: Score | None = None,
) -> None:
    """Train ``net`` in place.

    Args:
        net: whatever ``batch_error`` calls.
        batch_error: row indices (batch,) → prediction error (batch, channels).
        rows: number of rows to draw from.
        settings: the budget.
        loss: of an error and the progress.
        progress: called with (done, total) steps.
        score: looked at ``LOOKS`` times; the weights of the lowest are kept. None keeps the last.
    """
    generator = seeded(settings.seed)
    # the schedule gives the rate itself, as a factor of one
    optimizer = torch.optim.AdamW(net.parameters(), lr=1.0, weight_decay=settings.weight_decay)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, settings.rate)
    best, kept = math.inf, net.state_dict()
    look_every = max(1, settings.steps // LOOKS)
    net.train()
    for step in range(settings.steps):
        index = torch.randint(rows, (settings.batch,), generator=generator)
        value = loss(batch_error(index), step / settings.steps)
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
        schedule.step()
        if progress and step % 100 == 99:
            progress(step + 1, settings.steps)
        if score and (step + 1) % look_every == 0:
            now = score()
            if now < best:
                best, kept = now, copy.deepcopy(net.state_dict())
    if score:
        net.load_state_dict(kept)
    net.eval()
