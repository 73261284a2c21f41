"""Several processes that train one model together, each on its share of every batch.

Four optimizers update in turn, each with a loss that reaches through networks of the others.
DistributedDataParallel expects one backward pass over all parameters and waits for gradients that
never come; so the module averages the gradients of an optimizer itself, just before it steps
(:func:`average`), and the model is not wrapped. Losses are means over rows, so the averaged
gradient is that of the whole batch: the curve is the same on one process and on many.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch
import torch.distributed
import torch.multiprocessing
from lightning.fabric.plugins.environments import ClusterEnvironment
from lightning.pytorch.strategies import DDPStrategy
from torch import nn


class Place(NamedTuple):
    """Where a process stands among those that train together.

    Attributes:
        node: its machine, 0 for the one of the process that leads.
        local: its rank on that machine.
        devices: processes on each machine.
        nodes: machines.
        host: address of the process that leads, as the others know it.
        port: of the same.
    """

    node: int
    local: int
    devices: int
    nodes: int
    host: str
    port: int

    @property
    def rank(self) -> int:
        """Rank among all: 0 leads, and alone reports and writes."""
        return self.node * self.devices + self.local

    @property
    def size(self) -> int:
        """Number of processes."""
        return self.nodes * self.devices


def leading(devices: int, nodes: int, host: str = "127.0.0.1") -> Place:
    """The place of the process that leads, with a port that is free."""
    with socket.socket() as free:
        free.bind((host, 0))
        return Place(0, 0, devices, nodes, host, free.getsockname()[1])


class Placed(ClusterEnvironment):
    """The processes that :func:`followers` and :func:`wt.train.machines.joined` started."""

    def __init__(self, place: Place) -> None:
        """Stand in a place."""
        self._place = place

    creates_processes_externally = True

    @property
    def main_address(self) -> str:
        """Address of the leader."""
        return self._place.host

    @property
    def main_port(self) -> int:
        """Port of the leader."""
        return self._place.port

    @staticmethod
    def detect() -> bool:
        """Never by itself."""
        return False

    def world_size(self) -> int:
        """Number of processes."""
        return self._place.size

    def set_world_size(self, size: int) -> None:
        """It is what it is."""

    def global_rank(self) -> int:
        """Rank among all."""
        return self._place.rank

    def set_global_rank(self, rank: int) -> None:
        """It is what it is."""

    def local_rank(self) -> int:
        """Rank on this machine."""
        return self._place.local

    def node_rank(self) -> int:
        """The machine."""
        return self._place.node


class Unwrapped(DDPStrategy):
    """Lightning's DDP without the wrapper around the module, which averages by itself."""

    def configure_ddp(self) -> None:
        """Leave the module as it is."""


def average(parameters: Sequence[nn.Parameter]) -> None:
    """Replace gradients by their mean over all processes; nothing where one trains alone."""
    if not torch.distributed.is_initialized():
        return
    gradients = [p.grad for p in parameters if p.grad is not None]
    together = torch.cat([g.flatten() for g in gradients])
    torch.distributed.all_reduce(together)
    together /= torch.distributed.get_world_size()
    for gradient, mean in zip(
        gradients, together.split([g.numel() for g in gradients]), strict=True
    ):
        gradient.copy_(mean.view_as(gradient))


def end_with_parent() -> None:
    """End this process with the one that started it: do not train on for a run that is gone."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def followers(
    place: Place, follow: Callable[..., None], arguments: tuple[Any, ...]
) -> Iterator[None]:
    """Start the other processes of this machine; they end with this one, however it ends.

    Args:
        place: of this process, the first of its machine.
        follow: top-level function, called in each of the others with its place and ``arguments``.
        arguments: what it is given; tensors on the CPU are shared, not copied.
    """
    context = torch.multiprocessing.get_context("spawn")
    started = [
        context.Process(target=follow, args=(place._replace(local=k), *arguments), daemon=True)
        for k in range(1, place.devices)
    ]
    try:
        # Ctrl-C is for the leader, which ends them
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            for process in started:
                process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield
    finally:
        if torch.distributed.is_initialized():
            torch.distributed.destroy_process_group()
        for process in started:
            if process.pid is not None:
                process.kill()
                process.join()
