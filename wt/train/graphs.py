"""Gradients of a training step as CUDA graphs: recorded once, then replayed.

With networks of this size a CUDA device waits to be told its kernels, some hundred a step. A graph
is told as one (https://pytorch.org/docs/stable/notes/cuda.html#cuda-graphs). There is one for each
update of an iteration; gradients are averaged and optimizers step between them, as without.

What is recorded keeps its place in memory: batches are copied into the one that it was recorded
with, and every replay overwrites gradients and metrics where they are, also where others have since
reset the parameters' own (Lightning does before it validates).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor, nn

from wt.train.batches import StepBatch
from wt.train.phases import Metrics

WARM_UP = 3
"""Steps that are taken without graphs before one is recorded: libraries set themselves up in them,
and compiled networks are compiled."""

Losses = Callable[[StepBatch, Metrics], Iterator[Tensor]]


class Graphs:
    """The gradients of every update of an iteration."""

    def __init__(self, losses: Losses, each: Sequence[Sequence[nn.Parameter]]) -> None:
        """Set up.

        Args:
            losses: those of an iteration, one an update; fills the metrics that it is given.
            each: parameters of each update.
        """
        self._losses, self._each = losses, each
        self._graphs: list[torch.cuda.CUDAGraph] = []
        self._held: list[list[Tensor | None]] = []
        self._batch: StepBatch | None = None
        self._metrics: Metrics = {}
        self._taken = 0

    def gradients(self, batch: StepBatch, metrics: Metrics) -> Iterator[None]:
        """Compute the gradients of one update after the other.

        Args:
            batch: of always the same shape.
            metrics: filled with those of the iteration; overwritten by the next one.
        """
        self._taken += 1
        if self._taken <= WARM_UP:
            yield from gradients(self._losses(batch, metrics), self._each)
            return
        if self._batch is None:
            yield from self._record(batch)
        else:
            for here, new in zip(_tensors(self._batch), _tensors(batch), strict=True):
                here.copy_(new)
            recorded = zip(self._graphs, self._each, self._held, strict=True)
            for graph, parameters, gradients_there in recorded:
                graph.replay()
                for parameter, gradient in zip(parameters, gradients_there, strict=True):
                    parameter.grad = gradient
                yield
        metrics |= self._metrics

    def _record(self, batch: StepBatch) -> Iterator[None]:
        """Record the graphs, and replay each: recording computes nothing."""
        self._batch = batch
        pool, losses = torch.cuda.graph_pool_handle(), self._losses(batch, self._metrics)
        # what other threads tell the device in the meantime is none of the graph's
        mode = "thread_local"
        for parameters in self._each:
            graph = torch.cuda.CUDAGraph()
            _forget(parameters)
            with torch.cuda.graph(graph, pool=pool, capture_error_mode=mode):
                next(losses).backward(inputs=list(parameters))
            graph.replay()
            self._graphs.append(graph)
            self._held.append([parameter.grad for parameter in parameters])
            yield
        self._metrics = {name: value.detach() for name, value in self._metrics.items()}


def gradients(losses: Iterator[Tensor], each: Sequence[Sequence[nn.Parameter]]) -> Iterator[None]:
    """Compute the gradients of one update after the other.

    Losses reach through networks of other updates (D in the generators' loss, D_ψ in L_VAE): only
    an update's own parameters collect a gradient.

    Args:
        losses: one an update.
        each: parameters of each update.
    """
    for loss, parameters in zip(losses, each, strict=True):
        _forget(parameters)
        loss.backward(inputs=list(parameters))
        yield


def _forget(parameters: Sequence[nn.Parameter]) -> None:
    for parameter in parameters:
        parameter.grad = None


def _tensors(batch: tuple[object, ...]) -> Iterator[Tensor]:
    """All tensors of nested tuples, in order."""
    for value in batch:
        if isinstance(value, Tensor):
            yield value
        elif isinstance(value, tuple):
            yield from _tensors(value)
