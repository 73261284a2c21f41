"""The steps before a transition: windows gathered by index, or a part of the observation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Int
from torch import Tensor

from wt.types import Channel, Transitions, TransitionSpec


class History:
    """The rows that precede each row, inside the same episode.

    Attributes:
        length: steps before the present one in a window.
    """

    def __init__(self, data: Transitions, length: int) -> None:
        """Index a set of transitions.

        Args:
            data: ordered by episode and step.
            length: steps before the present one.
        """
        self.length = length
        self._step = torch.tensor(data.step, dtype=torch.long)
        self._episode = torch.tensor(data.episode, dtype=torch.long)
        self._back = torch.arange(length, 0, -1)

    def before(
        self, rows: Int[Tensor, " batch"]
    ) -> tuple[Int[Tensor, "batch history"], Bool[Tensor, "batch history"]]:
        """Rows of the steps before, oldest first, and which of them exist.

        Args:
            rows: rows of present transitions.

        Returns:
            Row indices (0 where there is none), and a mask that is False there.
        """
        index = rows[:, None] - self._back
        exists = index >= 0
        index = index.clamp_min(0)
        exists &= self._episode[index] == self._episode[rows, None]
        exists &= self._step[index] == self._step[rows, None] - self._back
        return index, exists


def with_history(spec: TransitionSpec, length: int) -> TransitionSpec:
    """A layout whose observation also has the joint positions and actions of the steps before.

    They stand behind the others, the step before first: all that is known without any prediction.
    """
    earlier = [
        Channel(f"{channel.name}@-{lag}", channel.unit)
        for lag in range(1, length + 1)
        for channel in (*(spec.observation[i] for i in spec.pose), *spec.action)
    ]
    return replace(spec, observation=(*spec.observation, *earlier))


def remember(data: Transitions, spec: TransitionSpec, length: int) -> tuple[
    Transitions, Int[np.ndarray, " row"]
]:  # fmt: skip
    """Transitions in the layout of :func:`with_history`.

    Args:
        data: in the layout of ``spec``, ordered by episode and step.
        spec: without history.
        length: steps.

    Returns:
        Those that have so many steps before them in their episode, and their rows in ``data``.
    """
    index, exists = History(data, length).before(torch.arange(len(data)))
    rows = np.flatnonzero(exists.all(dim=1).cpu().numpy())
    before = index.cpu().numpy()[rows][:, ::-1]  # the step before first
    past = np.concatenate([data.o[:, list(spec.pose)], data.a], axis=1)[before]
    kept = data.select(rows)
    return replace(kept, o=np.hstack([kept.o, past.reshape(len(rows), -1)])), rows
