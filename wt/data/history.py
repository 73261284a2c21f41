"""Windows of the steps before a transition, gathered by index instead of being stored."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from wt.types import Transitions


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
