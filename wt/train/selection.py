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
which would count for more than any translation. So both changes of the state lose what is linear in
(o, a), by R's own regression, and the energy distance of what is left is taken. Of 12 checkpoints
of the paper's method on a walking Go2, this took the one with the least error on test pairs; the
distance of (o, a, change) took one with 1.4 times its error.

What this does not see: whether a translation keeps *which* hidden event it was; and that a smaller
answer than R's would be nearer to R in the mean where S tells the event only roughly. Shares that
depend on this are not tried without pairs (``wt.nets.simulator_use.UNTRIED``).

``pairs`` scores both by the squared error on R's transitions, of which S's answer under what was
hidden then is known. Only an experiment with two simulators has these.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from wt.config import ModelSelection
from wt.data.stored import Stored
from wt.data.transitions import content_hash, digest
from wt.types import Pairs, Transitions

ROWS = 2000
"""Transitions of either domain whose distributions are compared; the time grows with the square."""
MOST = 10_000
"""Transitions of either domain that are held out at most: more would score no better."""
RIDGE = 1e-3
"""Of the regression on (o, a), in units of the variance of each of their channels."""
CONSTANT = 1e-6
"""A channel that varies less than this, in its own unit, has no scale."""


class Selection(ABC):
    """Held-out data that choose between models; of two errors the lower one is chosen.

    Attributes:
        name: as in a configuration.
        metric: what is measured, in one word.
        data: what it is measured on, in words.
        translated: transitions with the outcome in S that a translation is applied to.
        predicted: transitions of R, with the answer of S that a prediction may read.
        hash: of the data; errors compare only where it is the same.
    """

    name: ClassVar[ModelSelection]
    metric: ClassVar[str]
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
    data = "held-out transitions"

    def __init__(self, sim: Transitions, real: Transitions) -> None:
        """Keep the transitions, and regress R's changes on (o, a).

        Args:
            sim: of S, none of them trained on.
            real: of R, likewise, in order.
        """
        self.sim, self.real = sim, real
        some = _spread(sim)
        self.translated = Pairs(some, some.s_next)
        self.predicted = Pairs(real, real.nominal)
        self.hash = digest([content_hash(sim), content_hash(real)])
        known, change = _known(real), _change(real, real.s_next)
        self._center, self._unit = known.mean(axis=0), _spread_of(known)
        x = self._standard(known)
        ridge = RIDGE * len(x) * np.eye(x.shape[1])
        self._weights = np.linalg.solve(x.T @ x + ridge, x.T @ change)
        self._scale = _spread_of(change - x @ self._weights)
        few = _spread(real)
        self._of_real = self._left(few, few.s_next)

    def error(self, states: Float[Tensor, "row state"]) -> float:
        """Energy distance of what (o, a) do not tell linearly, in units of R's spread of it."""
        of_sim = self._left(self.translated.real, states.detach().cpu().numpy())
        return energy_distance(torch.tensor(of_sim), torch.tensor(self._of_real))

    def _left(
        self, data: Transitions, states: Float[np.ndarray, "row state"]
    ) -> Float32[np.ndarray, "row state"]:
        """Changes to these states without what is linear in (o, a)."""
        told = self._standard(_known(data)) @ self._weights
        left: np.ndarray = ((_change(data, states) - told) / self._scale).astype(np.float32)
        return left

    def _standard(self, known: Float[np.ndarray, "row known"]) -> Float[np.ndarray, "row one_more"]:
        """(o, a) in units of R's spread, and a one."""
        return np.hstack([(known - self._center) / self._unit, np.ones((len(known), 1))])


def energy_distance(x: Float[Tensor, "n channel"], y: Float[Tensor, "m channel"]) -> float:
    """2 E‖X − Y‖ − E‖X − X′‖ − E‖Y − Y′‖ of two samples (Székely and Rizzo 2013)."""
    between = 2.0 * torch.cdist(x, y).mean()
    return float(between - torch.cdist(x, x).mean() - torch.cdist(y, y).mean())


def hold_out(data: Transitions, share: float) -> tuple[Transitions, Transitions]:
    """The transitions that are trained on, and the last whole episodes, which are not.

    Args:
        data: ordered by episode and step.
        share: of them to hold out, at most; where episodes are long, a part of the last one.
    """
    return _without_last(data, _held_out(len(data), share))


def hold_out_stored(data: Stored, share: float) -> tuple[Stored, Transitions]:
    """:func:`hold_out` of transitions that stay on disk, but for those that are held out."""
    count = _held_out(len(data), share)
    # one more: whether an episode begins at the first is seen by the transition before
    _, held = _without_last(data.last(count + 1), count)
    return data.without_last(len(held)), held


def _held_out(transitions: int, share: float) -> int:
    return min(MOST, max(1, int(share * transitions)))


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
