"""Model selection: the held-out data that choose, and what they measure.

Early weights of a regressor, the closed-form transport, shares of the mean field, the checkpoint of
Algorithm 1, the strength of a translation, the share of a correction, the seed that is exported and
the champion of the registry: all are chosen by one :class:`Selection`, and none by the test pairs.
``model_selection`` of the configuration says by which.

``unpaired``, the default, needs nothing that a real robot does not give: transitions of either
domain that nothing is trained on. At R's (o, a) S's answer with nothing hidden is known as well,
but not its answer under what was hidden then. So what predicts R's outcome from (o, a) and its
past is scored by its error, as usual. A translation cannot be: it is scored by how far what it
makes of S's held-out transitions is from R's, as distributions. S goes to other (o, a) than R,
which would count for more than any translation. So both changes of the state lose what (o, a) tell,
by R's own regression, and the energy distance of what is left is taken. The regression has to be a
good one: without what is linear alone, errors of a translation on a walking Go2 drown in the rest.

Of the checkpoints of one training, where this is the measure, the last is kept: learning rates fall
to zero on the way to it, and a translation that has hardly begun may be as near in distribution (on
an R5 under forces after an eighth of the training, with twice the error of the last) while networks
that still swing pass by the lowest distance now and then.

What this does not see: whether a translation keeps *which* hidden event it was; and that a smaller
answer than R's would be nearer to R in the mean where S tells the event only roughly. Shares that
depend on this are not tried without pairs (``wt.nets.simulator_use.UNTRIED``).

``pairs`` scores both by the squared error on R's transitions, of which S's answer under what was
hidden then is known. Only an experiment with two simulators has these.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from wt.config import ModelSelection
from wt.data.stored import Stored, held_out
from wt.data.transitions import content_hash, digest
from wt.types import Pairs, Transitions

ROWS = 2000
"""Transitions of either domain whose distributions are compared; the time grows with the square."""
FEATURES = 2000
"""Random Fourier features of (o, a) that the regression has beside their own channels (Rahimi and
Recht 2007), where there are five times as many transitions; else fewer."""
RIDGE, HARDLY = 1e-2, 1e-6
"""Of the regression on these, and on what is linear, in units of the variance of each: S goes
farther than R did, and there what is linear is all that counts."""
CONSTANT = 1e-6
"""A channel that varies less than this, in its own unit, has no scale."""


class Selection(ABC):
    """Held-out data that choose between models; of two errors the lower one is chosen.

    Attributes:
        name: as in a configuration.
        metric: what is measured, in one word.
        tells_checkpoints: whether it tells the checkpoints of one training apart; else the last is
            kept.
        data: what it is measured on, in words.
        translated: transitions with the outcome in S that a translation is applied to.
        predicted: transitions of R, with the answer of S that a prediction may read.
        hash: of the data; errors compare only where it is the same.
    """

    name: ClassVar[ModelSelection]
    metric: ClassVar[str]
    tells_checkpoints: ClassVar[bool]
    data: ClassVar[str]
    translated: Pairs
    predicted: Pairs
    hash: str

    @abstractmethod
    def error(self, states: Float[Tensor, "row state"]) -> float:
        """Error of a translation.

        Args:
            states: what it makes of :attr:`translated`, physical units.
        """


class Paired(Selection):
    """``pairs``: squared error on pairs that nothing is trained on."""

    name = "pairs"
    metric = "mse"
    tells_checkpoints = True
    data = "validation pairs"

    def __init__(self, pairs: Pairs, scale: Float[np.ndarray, " state"]) -> None:
        """Keep the pairs.

        Args:
            pairs: none of them trained on.
            scale: standard deviation of R's next state, the unit of errors.
        """
        self.translated = self.predicted = pairs
        self.hash = content_hash(pairs)
        self._scale = scale

    def error(self, states: Float[Tensor, "row state"]) -> float:
        """Mean squared error of the normalised next state."""
        error = states - torch.tensor(self.translated.real.s_next)
        return float(((error / torch.tensor(self._scale)) ** 2).mean())


class Unpaired(Selection):
    """``unpaired``: distance of the distributions of transitions that nothing is trained on.

    Attributes:
        sim: transitions of S, none of them trained on.
        real: of R, likewise, in order.
    """

    name = "unpaired"
    metric = "energy_distance"
    tells_checkpoints = False
    data = "held-out transitions"

    def __init__(self, sim: Transitions, real: Transitions) -> None:
        """Keep the transitions.

        Args:
            sim: of S, none of them trained on.
            real: of R, likewise, in order.
        """
        self.sim, self.real = sim, real
        some = _spread(sim)
        self.translated = Pairs(some, some.s_next)
        self.predicted = Pairs(real, real.nominal)
        self.hash = digest([content_hash(sim), content_hash(real)])

    def error(self, states: Float[Tensor, "row state"]) -> float:
        """Energy distance of what (o, a) do not tell, in units of R's spread of it."""
        data, told = self.translated.real, self._told
        of_sim = (_change(data, states.detach().cpu().numpy()) - self._told_of_sim) / told.scale
        return energy_distance(
            torch.tensor(of_sim, dtype=torch.float32),
            torch.tensor(self._told.of_real, dtype=torch.float32),
        )

    @cached_property
    def _told(self) -> _Told:
        # not before it is asked for: what predicts R alone is scored without it
        return _Told(self.real)

    @cached_property
    def _told_of_sim(self) -> Float64[np.ndarray, "row state"]:
        # whatever makes the states, so that it is not told anew of every checkpoint
        return self._told.changes(self.translated.real)


class _Told:
    """What (o, a) tell of R's changes, by a regression on either half of its transitions.

    Attributes:
        of_real: changes of R without it, some of them, in units of their spread.
        scale: that spread.
    """

    of_real: Float64[np.ndarray, "row state"]
    scale: Float64[np.ndarray, " state"]

    def __init__(self, real: Transitions) -> None:
        known = _known(real)
        self._center, self._moving = known.mean(axis=0), known.std(axis=0) > CONSTANT
        self._unit = known.std(axis=0)[self._moving]
        self._direction, self._phase = _waves(len(self._unit), min(FEATURES, len(known) // 5))
        rows = np.arange(len(real))
        halves = [real.select(half) for half in np.array_split(rows, 2)]
        weights = [self._regressed(half) for half in halves]
        # each half by the other's regression: of its own it would leave too little
        left = np.concatenate(
            [
                self._beyond(half, half.s_next, by)
                for half, by in zip(halves, reversed(weights), strict=True)
            ]
        )
        self._weights, self.scale = np.mean(weights, axis=0), _spread_of(left)
        few = np.linspace(0, len(left) - 1, min(ROWS, len(left))).round().astype(int)
        self.of_real = left[few] / self.scale

    def changes(self, data: Transitions) -> Float64[np.ndarray, "row state"]:
        """What (o, a) tell of R's changes."""
        return np.asarray(self._features(_known(data)) @ self._weights)

    def _beyond(
        self,
        data: Transitions,
        states: Float[np.ndarray, "row state"],
        weights: Float[np.ndarray, "feature state"],
    ) -> Float64[np.ndarray, "row state"]:
        told = self._features(_known(data)) @ weights
        return np.asarray(_change(data, states) - told)

    def _regressed(self, real: Transitions) -> Float64[np.ndarray, "feature state"]:
        """Weights of the features that predict these changes."""
        x = self._features(_known(real))
        ridge = np.repeat([HARDLY, RIDGE, HARDLY], [len(self._unit), len(self._phase), 1])
        squares = x.T @ x + len(x) * np.diag(ridge)
        return np.asarray(np.linalg.solve(squares, x.T @ _change(real, real.s_next)))

    def _features(
        self, known: Float[np.ndarray, "row known"]
    ) -> Float64[np.ndarray, "row feature"]:
        """(o, a) in units of R's spread, waves along random directions of them, and a one."""
        x = (known - self._center)[:, self._moving] / self._unit
        waves = np.sqrt(2.0) * np.cos(x @ self._direction + self._phase)
        return np.hstack([x, waves, np.ones((len(known), 1))])


def _waves(
    channels: int, count: int
) -> tuple[Float64[np.ndarray, "channel wave"], Float64[np.ndarray, " wave"]]:
    """Directions and phases whose waves, summed, make functions as smooth as a Gaussian kernel."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(channels, count)) / np.sqrt(channels)
    return direction, rng.uniform(0.0, 2.0 * np.pi, count)


def energy_distance(x: Float[Tensor, "n channel"], y: Float[Tensor, "m channel"]) -> float:
    """2 E‖X − Y‖ − E‖X − X′‖ − E‖Y − Y′‖ of two samples (Székely and Rizzo 2013)."""
    between, of_x, of_y = (torch.cdist(a, b).mean() for a, b in ((x, y), (x, x), (y, y)))
    return float(2.0 * between - of_x - of_y)


def hold_out(data: Transitions, share: float) -> tuple[Transitions, Transitions]:
    """The transitions that are trained on, and the last whole episodes, which are not.

    Args:
        data: ordered by episode and step.
        share: of them to hold out, at most; where episodes are long, a part of the last one.
    """
    return _without_last(data, held_out(len(data), share))


def hold_out_stored(data: Stored, share: float) -> tuple[Stored, Transitions]:
    """:func:`hold_out` of transitions that stay on disk, but for those that are held out."""
    count = held_out(len(data), share)
    # one more: whether an episode begins at the first is seen by the transition before
    _, held = _without_last(data.last(count + 1), count)
    return data.without_last(len(held)), held


def _without_last(data: Transitions, count: int) -> tuple[Transitions, Transitions]:
    """Divide off about the last ``count`` transitions, where an episode begins."""
    first = len(data) - count
    begins = np.flatnonzero(np.diff(data.episode, prepend=data.episode[0] - 1))
    whole = begins[(begins >= first) & (begins <= first + count // 2)]
    first = int(whole[0]) if len(whole) else first
    rows = np.arange(len(data))
    return data.select(rows[:first]), data.select(rows[first:])


def _spread(data: Transitions) -> Transitions:
    """At most :data:`ROWS` transitions, evenly spread."""
    rows = np.linspace(0, len(data) - 1, min(ROWS, len(data)))
    return data.select(rows.round().astype(int))


def _known(data: Transitions) -> Float[np.ndarray, "row known"]:
    """(o, a), in double precision."""
    return np.hstack([data.o, data.a]).astype(np.float64)


def _change(
    data: Transitions, states: Float[np.ndarray, "row state"]
) -> Float[np.ndarray, "row state"]:
    """Change of the state to these states, in double precision."""
    return states.astype(np.float64) - data.o[:, : states.shape[1]]


def _spread_of(values: Float[np.ndarray, "row channel"]) -> Float[np.ndarray, " channel"]:
    """Standard deviation of each channel; 1 for one that does not move."""
    std = values.std(axis=0)
    return np.where(std > CONSTANT, std, 1.0)
