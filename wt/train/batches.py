"""The data of each training step: a pure function of the seed and the step.

Step k draws its rows and its noise from a generator seeded with (seed, k) alone. A run that is
killed and resumed therefore sees exactly what an uninterrupted one sees, with no random state to
save.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
import torch
from torch import Tensor

from wt.nets.frame import Frame
from wt.nets.mlp import CHUNK, in_chunks
from wt.train.device import seeded
from wt.train.segments import Segments, TrajectorySegment
from wt.types import Domain, Transitions


class DomainData(NamedTuple):
    """One domain's transitions in the frame of a model, in memory.

    Attributes:
        x: normalised (o, a), (N, n_condition).
        y: normalised outcome that networks encode and decode, (N, n_state).
        s_next: normalised next state, the blind decoder's target, (N, n_state).
    """

    x: Tensor
    y: Tensor
    s_next: Tensor

    def rows(self, index: Tensor) -> DomainData:
        """The transitions at ``index``."""
        return DomainData(self.x[index], self.y[index], self.s_next[index])


Rows = TypeVar("Rows", bound=tuple[Tensor, ...], covariant=True)
"""A named tuple of tensors that have one row for each transition."""


@runtime_checkable
class Feed(Protocol[Rows]):
    """Transitions of which each step draws some: in memory, or streamed."""

    def at(self, step: int) -> Rows:
        """Those that a step draws from, a pure function of the step."""
        ...


class Held(Generic[Rows]):
    """Transitions in memory: every step draws from all of them."""

    def __init__(self, rows: Rows) -> None:
        """Keep the reference."""
        self._rows = rows

    def at(self, step: int) -> Rows:
        """All of them, whatever the step."""
        return self._rows

    def to(self, device: torch.device) -> Held[Rows]:
        """The same on another device."""
        return Held(type(self._rows)(*(tensor.to(device) for tensor in self._rows)))


@runtime_checkable
class Drawn(Feed[DomainData], Protocol):
    """One domain's transitions as Algorithm 1 draws them."""

    def to(self, device: torch.device) -> Drawn:
        """The same on another device."""
        ...


def in_frame(frame: Frame, sim: Transitions, real: Transitions) -> tuple[DomainData, DomainData]:
    """Both domains' transitions as the networks see them."""
    return framed(frame, sim, "sim"), framed(frame, real, "real")


@torch.no_grad()
def framed(frame: Frame, data: Transitions, domain: Domain) -> DomainData:
    """One domain's transitions as the networks see them.

    With a mean field, S's outcome is what it does beyond n, and R's what it does beyond n and the
    shift. Where n imitates the answer with nothing hidden, that is known exactly here.
    """
    o, a = torch.tensor(data.o), torch.tensor(data.a)
    s_next = torch.tensor(data.s_next)
    x, y = frame.conditions(o, a), frame.changes(o, s_next)
    nominal = frame.changes(o, torch.tensor(data.nominal))
    if frame.nominal is not None:
        if not frame.imitates_nominal:
            nominal = in_chunks(frame.nominal_change, x)
        y = y - nominal
    if domain == "real":
        parts = zip(x.split(CHUNK), nominal.split(CHUNK), strict=True)
        y = y - torch.cat([frame.shift_change(xs, ns) for xs, ns in parts])
    else:
        y = y @ frame.transport.T
    return DomainData(x, y, frame.state(s_next))


def within(frame: Frame, data: Transitions, reach: float) -> Transitions:
    """The transitions that are translated: of the others a few would outweigh many."""
    if not reach:
        return data
    x = frame.conditions(torch.tensor(data.o), torch.tensor(data.a))
    return data.select(frame.within(x, reach).cpu().numpy())


class StepBatch(NamedTuple):
    """The data of one step of Algorithm 1.

    Attributes:
        step: index of the step.
        vae: a batch of S and one of R for backward dynamics extraction.
        gan: another batch of each for translation.
        noise: standard normal noise for the four reparametrisations, (4, batch, latent).
        segment: stretches of R, where training is on segments.
    """

    step: int
    vae: tuple[DomainData, DomainData]
    gan: tuple[DomainData, DomainData]
    noise: Tensor
    segment: TrajectorySegment | None = None


class StepBatches:
    """Endless deterministic batches, starting at a given step."""

    def __init__(
        self,
        sim: Drawn,
        real: Drawn,
        batch: int,
        latent: int,
        seed: int,
        segments: Segments | None = None,
        part: tuple[int, int] = (0, 1),
    ) -> None:
        """Keep references to both domains' data.

        Args:
            sim: transitions of S.
            real: transitions of R.
            batch: transitions per domain and step.
            latent: size of z, for the noise.
            seed: same seed, same batches.
            segments: where training is on segments too.
            part: (rank, number) of the processes that share each batch; each has every so-manieth
                row.
        """
        self._part = part
        self._segments = segments
        self._sim, self._real = sim, real
        self._batch, self._latent, self._seed = batch, latent, seed
        self.next_step = 0

    def at(self, step: int) -> StepBatch:
        """The batch of one step."""
        # torch looks at 32 bits of a seed only, so both numbers are hashed into those
        hashed = int(np.random.SeedSequence((self._seed, step)).generate_state(1)[0])
        generator = seeded(hashed)
        rank, size = self._part

        def draw(domain: Drawn) -> DomainData:
            data = domain.at(step)
            index = torch.randint(len(data.x), (self._batch,), generator=generator)
            return data.rows(index[rank::size])

        vae = draw(self._sim), draw(self._real)
        gan = draw(self._sim), draw(self._real)
        noise = torch.randn(4, self._batch, self._latent, generator=generator)
        # all have all segments: their number need not be a multiple of the processes'
        segment = self._segments.draw(generator) if self._segments else None
        return StepBatch(step, vae, gan, noise[:, rank::size], segment)

    def __iter__(self) -> Iterator[StepBatch]:
        """Batches from ``next_step`` on."""
        while True:
            yield self.at(self.next_step)
            self.next_step += 1
