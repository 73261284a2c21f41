"""Transitions that are streamed from disk while a model is trained on them.

A buffer holds a few row groups, and batches are drawn from it at random. After a fixed number of
steps the row group that came first makes place for the next one, in an order that is shuffled anew
for each epoch. So the buffer of step k is a pure function of the seed and of k, as its batch is: a
run that is resumed reads one buffer, and goes on as if it had not stopped.
"""

from __future__ import annotations

import copy

import numpy as np
import torch

from wt.data.stored import Stored, Streams
from wt.nets.frame import Frame
from wt.nets.world_model import WorldModel
from wt.train.batches import DomainData, Drawn, framed, within
from wt.types import Domain, Transitions

DRAWS = 8
"""Times that a transition is drawn, on average, while it is in the buffer.

Once would see the most of a collection; but to read a transition and bring it into the frame takes
longer than to train on it where a mean field has to be evaluated.
"""
NOWHERE = -2
"""The turn of a buffer that holds nothing, which none follows."""
EMPTY = DomainData(*3 * [torch.empty(0)])


class Streamed:
    """One domain's transitions in the frame of a model, of which memory holds a few row groups."""

    def __init__(
        self,
        stored: Stored,
        frame: Frame,
        domain: Domain,
        *,
        in_memory: int,
        batch: int,
        reach: float,
        seed: int,
    ) -> None:
        """Read nothing yet.

        Args:
            stored: the transitions.
            frame: fitted, with its mean field; it is copied.
            domain: of the transitions.
            in_memory: transitions that are held at most; at least a row group is.
            batch: transitions per step that are drawn twice, for features and for translation.
            reach: as in :meth:`Frame.within`; transitions beyond are left out.
            seed: same seed, same order.
        """
        self._stored, self._domain, self._reach, self._seed = stored, domain, reach, seed
        self._frame = copy.deepcopy(frame).requires_grad_(False)
        self._width = min(len(stored.groups), max(1, in_memory // stored.largest))
        self._steps = max(1, DRAWS * stored.largest // (2 * batch))
        self._turn, self._sizes, self._buffer = NOWHERE, list[int](), EMPTY

    def at(self, step: int) -> DomainData:
        """The buffer of a step."""
        turn = step // self._steps
        if turn != self._turn:
            self._buffer = self._moved(turn)
            self._turn = turn
        return self._buffer

    def to(self, device: torch.device) -> Streamed:
        """The same on another device, with an empty buffer."""
        moved = copy.copy(self)
        moved._frame = copy.deepcopy(self._frame).to(device)
        moved._turn, moved._sizes, moved._buffer = NOWHERE, [], EMPTY
        return moved

    def _moved(self, turn: int) -> DomainData:
        """The buffer after so many row groups have made place."""
        if turn == self._turn + 1:
            coming, gone = [self._group(turn + self._width - 1)], self._sizes.pop(0)
            staying = [tensor[gone:] for tensor in self._buffer]
        else:
            self._sizes, self._buffer = [], EMPTY  # so that no two buffers are held
            coming = [self._group(turn + k) for k in range(self._width)]
            staying = [tensor[:0] for tensor in coming[0]]
        self._sizes += [len(group.x) for group in coming]
        columns = zip(staying, *coming, strict=True)
        return DomainData(*(torch.cat(column) for column in columns))

    def _group(self, place: int) -> DomainData:
        """The row group at a place of the order that has no end."""
        epoch, place = divmod(place, len(self._stored.groups))
        order = np.random.default_rng((self._seed, self._domain == "real", epoch))
        group = int(order.permutation(len(self._stored.groups))[place])
        data = within(self._frame, self._stored.read(group), self._reach)
        return framed(self._frame, data, self._domain)


def drawn(
    model: WorldModel, sim: Transitions, real: Transitions, streams: Streams, seed: int
) -> tuple[Drawn, Drawn]:
    """Both domains in a model's frame, as the steps of its training draw from them.

    Args:
        model: with a fitted frame and mean field.
        sim: transitions of S that memory holds.
        real: of R, likewise.
        streams: collections that are streamed in their place.
        seed: same seed, same order of what is streamed.
    """
    method = model.method

    def one(data: Transitions, domain: Domain, stored: Stored | None) -> Drawn:
        if stored is None:
            return framed(model.frame, data, domain)
        return Streamed(
            stored,
            model.frame,
            domain,
            in_memory=streams.in_memory,
            batch=method.train.batch,
            reach=method.translation.reach,
            seed=seed,
        )

    return one(sim, "sim", streams.sim), one(real, "real", streams.real)
