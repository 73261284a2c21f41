"""The multilayer perceptron that every other network here is made of, and averages of some."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

CHUNK = 16384
"""Rows that a network answers to at once where nothing is learned."""


def mlp(
    inputs: int,
    outputs: int,
    width: int,
    depth: int,
    activation: Callable[[], nn.Module] = nn.SiLU,
    zero_last: bool = False,
) -> nn.Sequential:
    """``depth`` hidden layers of ``width`` units, then a linear output.

    Args:
        inputs: size of the input.
        outputs: size of the output.
        width: units per hidden layer.
        depth: number of hidden layers; 0 gives a linear map.
        activation: module between layers.
        zero_last: start with an output of exactly zero, for residual branches.
    """
    layers: list[nn.Module] = []
    size = inputs
    for _ in range(depth):
        layers += [nn.Linear(size, width), activation()]
        size = width
    last = nn.Linear(size, outputs)
    if zero_last:
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
    return nn.Sequential(*layers, last)


class Ensemble(nn.Module):
    """The average of several networks; the members are trained one by one."""

    def __init__(self, members: Sequence[nn.Module]) -> None:
        """Keep the members."""
        super().__init__()
        self.members = nn.ModuleList(members)

    def forward(self, x: Tensor) -> Tensor:
        """The members' mean output."""
        return torch.stack([member(x) for member in self.members]).mean(dim=0)


@torch.no_grad()
def in_chunks(net: Callable[[Tensor], Tensor], inputs: Tensor) -> Tensor:
    """A network's answers to many rows, without holding all activations."""
    return torch.cat([net(part) for part in inputs.split(CHUNK)])
