"""Supervised regression: the mean field's and the baselines' one loop."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from wt.nets.mlp import Ensemble
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
    rows: int | Callable[[int], int],
    settings: Regression,
    loss: Loss = mean_square,
    progress: Progress | None = None,
    score: Score | None = None,
) -> None:
    """Train ``net`` in place.

    Args:
        net: whatever ``batch_error`` calls.
        batch_error: row indices (batch,) → prediction error (batch, channels).
        rows: number of rows to draw from; where they are streamed, a function that brings those of
            a step and says how many they are.
        settings: the budget.
        loss: of an error and the progress.
        progress: called with (done, total) steps.
        score: looked at ``LOOKS`` times; the weights of the lowest are kept. None keeps the last.
    """
    generator = seeded(settings.seed)
    # the schedule gives the rate itself, as a factor of one
    optimizer = torch.optim.AdamW(
        net.parameters(), lr=1.0, weight_decay=settings.weight_decay, fused=True
    )
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, settings.rate)
    best = BestWeights(net, score, settings.steps)
    net.train()
    for step in range(settings.steps):
        count = rows if isinstance(rows, int) else rows(step)
        index = torch.randint(count, (settings.batch,), generator=generator)
        value = loss(batch_error(index), step / settings.steps)
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
        schedule.step()
        tell(progress, step + 1, settings.steps)
        best.look(step)
    best.restore()
    net.eval()


def regress_on(
    net: nn.Module,
    inputs: Tensor,
    target: Tensor,
    settings: Regression,
    loss: Loss = mean_square,
    progress: Progress | None = None,
    score: Score | None = None,
) -> None:
    """:func:`regress` of answers, (row, channel), to inputs, (row, input)."""

    def error(rows: Tensor) -> Tensor:
        out: Tensor = net(inputs[rows]) - target[rows]
        return out

    regress(net, error, len(inputs), settings, loss, progress, score)


def tell(progress: Progress | None, done: int, total: int) -> None:
    """Tell of every hundredth of the steps, and of the last."""
    if progress and (done % max(1, total // 100) == 0 or done == total):
        progress(done, total)


class BestWeights:
    """The weights of a network at the look, of ``LOOKS``, that scored lowest."""

    def __init__(self, net: nn.Module, score: Score | None, steps: int) -> None:
        """Look at a network while it is trained.

        Args:
            net: the network.
            score: what is to be low; None keeps the last weights.
            steps: of the training.
        """
        self._net, self._score, self._every = net, score, max(1, steps // LOOKS)
        self._best, self._kept = math.inf, net.state_dict()

    def look(self, step: int) -> None:
        """After a step, by its index; scores when it is time."""
        if self._score is None or (step + 1) % self._every:
            return
        now = self._score()
        if now < self._best:
            self._best, self._kept = now, copy.deepcopy(self._net.state_dict())

    def restore(self) -> None:
        """Go back to the best weights."""
        if self._score is not None:
            self._net.load_state_dict(self._kept)


def one_by_one(ensemble: Ensemble) -> Iterator[tuple[int, nn.Module]]:
    """Each member, as the ensemble's only one: the others would hide what it scores."""
    members = list(ensemble.members)
    for k, member in enumerate(members):
        ensemble.members = nn.ModuleList([member])
        yield k, member
    ensemble.members = nn.ModuleList(members)


def member_seed(seed: int, k: int) -> int:
    """Seed of an ensemble's member, so that members see other batches."""
    return seed + 1000 * k


def part_of(progress: Progress | None, done: int, total: int) -> Progress | None:
    """Progress of one regression among several, after ``done`` of ``total`` steps of all."""
    return progress and (lambda k, _: progress(done + k, total))
