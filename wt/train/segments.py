"""Training on segments of trajectories: the decoder learns to go on from its own predictions.

A transition's feature z is extracted from what was observed; the outcome is decoded at the
observation that the decoder itself predicted one step before, and so on along the segment. The
paper trains single steps and names this as future work. Segments are R's: its outcomes are what
is decoded in use.
"""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from wt.nets.world_model import WorldModel
from wt.types import Transitions


class TrajectorySegment(NamedTuple):
    """Stretches of consecutive transitions of R, physical units.

    Attributes:
        o: observations, (batch, length, n_obs).
        a: actions, (batch, length, n_action).
        s_next: state channels after each step, (batch, length, n_state).
    """

    o: Tensor
    a: Tensor
    s_next: Tensor


class Segments:
    """Draws segments; a pure function of the generator that it is given."""

    def __init__(self, real: Transitions, length: int, batch: int) -> None:
        """Find where segments may begin.

        Args:
            real: transitions of R, ordered by episode and step.
            length: transitions of a segment.
            batch: transitions per draw, so that a longer segment does not cost more.
        """
        self._data = [torch.tensor(x) for x in (real.o, real.a, real.s_next)]
        self._along, self._count = torch.arange(length), max(1, batch // length)
        last = np.arange(len(real)) + length - 1
        inside = last < len(real)
        last = np.minimum(last, len(real) - 1)
        complete = inside & (real.episode[last] == real.episode)
        complete &= real.step[last] == real.step + length - 1
        self._starts = torch.tensor(np.flatnonzero(complete))

    def to(self, device: torch.device) -> Segments:
        """The same on another device."""
        moved = copy.copy(self)
        moved._data = [x.to(device) for x in self._data]
        moved._along, moved._starts = self._along.to(device), self._starts.to(device)
        return moved

    def draw(self, generator: torch.Generator) -> TrajectorySegment | None:
        """Some segments; None if no episode is so long."""
        if not len(self._starts):
            return None
        picked = torch.randint(len(self._starts), (self._count,), generator=generator)
        rows = self._starts[picked][:, None] + self._along
        return TrajectorySegment(*(x[rows] for x in self._data))


def segment_error(model: WorldModel, segment: TrajectorySegment) -> Tensor:
    """Squared error of the normalised state along segments, each step from the last's outcome.

    Summed over channels, as the reconstruction that it is added to, and averaged over the rest.

    The first step starts from an observation; single-step training has it already, so it is left
    out of the mean.
    """
    frame, n = model.frame, model.spec.n_state
    o, total = segment.o[:, 0], segment.o.new_zeros(())
    length = segment.o.shape[1]
    for k in range(length):
        seen, a, s_next = segment.o[:, k], segment.a[:, k], segment.s_next[:, k]
        x = frame.conditions(seen, a)
        change = frame.changes(seen, s_next)
        z, _ = model.encoder(x, change - frame.nominal_change(x) - frame.shift_of_real(x, change))
        # ô_{t+1} = D(ô_t, a_t, z_t)
        x = frame.conditions(o, a)
        outcome = frame.nominal_change(x) + model.decoder(x, z)
        change = outcome + frame.shift_of_real(x, outcome)
        state = frame.next_states(o, change)
        if k:
            total = total + (((state - s_next) / frame.change.std) ** 2).sum(-1).mean()
        if k + 1 < length:
            # what follows the state is known without any prediction
            o = torch.cat([state, segment.o[:, k + 1, n:]], dim=-1)
    return total / (length - 1)
