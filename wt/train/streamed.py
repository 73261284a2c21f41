"""Transitions that are streamed from disk while a model is trained on them.

A buffer holds a few row groups, and batches are drawn from it at random. After a fixed number of
steps the row group that came first makes place for the next one, in an order that is shuffled anew
for each epoch. So the buffer of step k is a pure function of the seed and of k, as its batch is: a
run that is resumed reads one buffer, and goes on as if it had not stopped.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Generic

import numpy as np
import torch

from wt.data.stored import Stored, Streams
from wt.nets.frame import Frame
from wt.nets.simulator_use import DomainSamples
from wt.nets.world_model import WorldModel
from wt.train.batches import DomainData, Drawn, Feed, Held, Rows, framed, within
from wt.train.mean_field import samples
from wt.types import Domain, Transitions

DRAWS = 8
"""Times that a transition is drawn, on average, while it is in the buffer.

Once would show the most of a collection. But where a mean field has to be evaluated, to read a
transition and bring it into the frame then takes a seventh of the time to train on it.
"""
ANSWERED = 64
"""The same where S has to answer what comes, which takes it as long as some 500 steps of training
a row group of 32 768 transitions."""
NOWHERE = -2
"""The turn of a buffer that holds nothing, which none follows."""


class Streamed(Generic[Rows]):
    """One domain's transitions, of which memory holds a few row groups."""

    def __init__(
        self,
        stored: Stored,
        made: Callable[[Transitions], Rows],
        *,
        in_memory: int,
        a_step: int,
        seed: tuple[int, ...],
        draws: int = DRAWS,
    ) -> None:
        """Read nothing yet.

        Args:
            stored: the transitions.
            made: what is drawn from, of a row group's transitions; it may leave some out.
            in_memory: transitions that are held at most; at least a row group is.
            a_step: transitions that a step draws.
            seed: same seed, same order.
            draws: times that a transition is drawn, on average, while it is held.
        """
        self._stored, self._made, self._seed = stored, made, seed
        self._width = min(len(stored.groups), max(1, in_memory // stored.largest))
        self._steps = max(1, draws * stored.largest // a_step)
        self._turn, self._sizes = NOWHERE, list[int]()
        self._buffer: Rows | None = None

    def at(self, step: int) -> Rows:
        """The buffer of a step."""
        turn = step // self._steps
        if self._buffer is None or turn != self._turn:
            self._buffer = self._moved(turn)
            self._turn = turn
        return self._buffer

    def _moved(self, turn: int) -> Rows:
        """The buffer after so many row groups have made place."""
        if self._buffer is not None and turn == self._turn + 1:
            coming, gone = [self._group(turn + self._width - 1)], self._sizes.pop(0)
            staying = [tensor[gone:] for tensor in self._buffer]
        else:
            self._sizes, self._buffer = list[int](), None  # so that no two buffers are held
            coming = [self._group(turn + k) for k in range(self._width)]
            staying = [tensor[:0] for tensor in coming[0]]
        self._sizes += [len(group[0]) for group in coming]
        columns = zip(staying, *coming, strict=True)
        return type(coming[0])(*(torch.cat(column) for column in columns))

    def _group(self, place: int) -> Rows:
        """The row group at a place of the order that has no end."""
        epoch, place = divmod(place, len(self._stored.groups))
        order = np.random.default_rng((*self._seed, epoch))
        group = int(order.permutation(len(self._stored.groups))[place])
        return self._made(self._stored.read(group))


class StreamedInFrame(Streamed[DomainData]):
    """One domain's transitions in the frame of a model, as Algorithm 1 draws them."""

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
        self._frame = copy.deepcopy(frame).requires_grad_(False)
        self._domain, self._reach = domain, reach
        order = seed, int(domain == "real")
        super().__init__(stored, self._framed, in_memory=in_memory, a_step=2 * batch, seed=order)

    def to(self, device: torch.device) -> StreamedInFrame:
        """The same on another device, with an empty buffer."""
        moved = copy.copy(self)
        moved._frame = copy.deepcopy(self._frame).to(device)
        moved._made, moved._turn, moved._buffer = moved._framed, NOWHERE, None
        return moved

    def _framed(self, data: Transitions) -> DomainData:
        return framed(self._frame, within(self._frame, data, self._reach), self._domain)


def drawn(
    model: WorldModel, sim: Transitions, real: Transitions, streams: Streams, seed: int
) -> tuple[Drawn, Drawn]:
    """Both domains in a model's frame, as the steps of Algorithm 1 draw from them.

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
            return Held(framed(model.frame, data, domain))
        return StreamedInFrame(
            stored,
            model.frame,
            domain,
            in_memory=streams.in_memory,
            batch=method.train.batch,
            reach=method.translation.reach,
            seed=seed,
        )

    return one(sim, "sim", streams.sim), one(real, "real", streams.real)


def lessons(
    model: WorldModel,
    sim: Transitions,
    real: Transitions,
    streams: Streams,
    seed: int,
    answered: Callable[[Transitions], Transitions] | None = None,
) -> tuple[Feed[DomainSamples], Feed[DomainSamples]]:
    """Both domains as the steps of a mean field's regressions draw from them.

    Args:
        model: with fitted normalisers.
        sim: transitions of S that memory holds.
        real: of R, likewise.
        streams: collections that are streamed in their place.
        seed: same seed, same order of what is streamed.
        answered: gives R's transitions S's answers, as those in memory have them.
    """
    frame, method = model.frame, model.method

    def one(data: Transitions, domain: Domain, stored: Stored | None) -> Feed[DomainSamples]:
        def made(group: Transitions) -> DomainSamples:
            if answered and domain == "real":
                group = answered(group)
            return samples(frame, within(frame, group, method.translation.reach))

        if stored is None:
            return Held(samples(frame, data))
        asked = answered is not None and domain == "real"
        return Streamed(
            stored,
            made,
            in_memory=streams.in_memory,
            a_step=method.mean.batch,
            seed=(seed, 2 + (domain == "real")),
            draws=ANSWERED if asked else DRAWS,
        )

    return one(sim, "sim", streams.sim), one(real, "real", streams.real)
