"""Uses of the simulator's own answer in the mean field: one class for each ``mean.simulator``.

A class says which regressors a frame holds, what each of them learns, and what model selection
tries. The other half of a mean field, ``mean.kind``, is the loss that they learn with:
:func:`wt.train.mean_field.shift_loss`; of kind ``none`` the use is :class:`Absent`.

Adding one: subclass :class:`SimulatorUse`, enter it in :data:`USES` and its name in
:data:`wt.config.SimulatorUseName`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from wt.config import Mean, SimulatorUseName

ALL = (1.0,)
"""Shares where nothing but the whole is tried."""
UNTRIED = 0.5
"""A share that only pairs could tell: the one of least regret in the worst case.

The error grows with the square of the distance from the best share, which may be any of 0 … 1.
"""


class DomainSamples(NamedTuple):
    """Transitions of one domain as regressors see them, normalised.

    Attributes:
        x: (o, a).
        nominal: change of the simulator with nothing hidden.
        change: change that came out.
    """

    x: Float[Tensor, "row condition"]
    nominal: Float[Tensor, "row state"]
    change: Float[Tensor, "row state"]


class Examples(NamedTuple):
    """Inputs of a regressor, and the answers that it is to give."""

    inputs: Float[Tensor, "row input"]
    target: Float[Tensor, "row state"]


class SimulatorUse:
    """``base``: δ is added to the simulator's answer. The others say where they differ from it.

    Attributes:
        has_shift: there is a mean field at all.
        has_nominal: there is an n, which imitates the simulator.
        imitates_nominal: n imitates its answer with nothing hidden, which transitions have exactly.
        has_reader: a second correction reads S's answer, and has a share of each channel.
        shift_reads_simulator: S's answer is an input of δ.
        asks_simulator: while δ learns, S's answer is what it would have been to R's transitions.
        keeps_outcome: S's outcome beyond n, or all of it where there is no n, is a part of R's.
        transported: closed-form transport of that outcome may be tried.
        scored_alone: pairs score each regressor by itself, not the whole translation.
        shift_shares: of δ, of which model selection takes one.
        outcome_shares: of what S does beyond n, of which pairs take one.
        untried_share: of the same, where there are no pairs.
        translates_unpaired: Algorithm 1 is of use where there are no pairs.
        alone: what answers where nothing is translated, in a table's footnote.
    """

    has_shift: ClassVar[bool] = True
    has_nominal: ClassVar[bool] = True
    imitates_nominal: ClassVar[bool] = True
    has_reader: ClassVar[bool] = False
    shift_reads_simulator: ClassVar[bool] = False
    asks_simulator: ClassVar[bool] = False
    keeps_outcome: ClassVar[bool] = True
    transported: ClassVar[bool] = True
    scored_alone: ClassVar[bool] = False
    shift_shares: ClassVar[tuple[float, ...]] = ALL
    outcome_shares: ClassVar[tuple[float, ...]] = ALL
    untried_share: ClassVar[float] = 1.0
    translates_unpaired: ClassVar[bool] = True
    alone: ClassVar[str] = "the mean field answers alone"

    def nominal_examples(self, sim: DomainSamples, real: DomainSamples) -> Examples:
        """Lessons of n: S's answer with nothing hidden, which is known for both domains."""
        return Examples(torch.cat([sim.x, real.x]), torch.cat([sim.nominal, real.nominal]))

    def reference(
        self, nominal: Callable[[Tensor], Tensor], real: DomainSamples
    ) -> Float[Tensor, "row state"]:
        """The change that δ is added to.

        Args:
            nominal: n, from normalised (o, a).
            real: transitions of R.
        """
        return real.nominal

    def shift_examples(
        self, real: DomainSamples, reference: Float[Tensor, "row state"]
    ) -> Examples:
        """Lessons of δ: R's difference from the reference."""
        reads = [real.x, reference] if self.shift_reads_simulator else [real.x]
        return Examples(torch.cat(reads, dim=1), real.change - reference)

    def reader_examples(self, real: DomainSamples) -> Examples:
        """Lessons of the reader: R's difference from S's answer, which it sees."""
        return Examples(torch.cat([real.x, real.nominal], dim=1), real.change - real.nominal)

    def regressions(self, members: int) -> int:
        """Number of regressions with so many members an ensemble."""
        return (self.has_shift + self.has_reader) * members + self.has_nominal


class Read(SimulatorUse):
    """``read``: δ is added to the simulator's answer, and reads it too."""

    shift_reads_simulator = True


class Average(SimulatorUse):
    """``mean``: S's average answer to (o, a) stands for its answer with nothing hidden.

    For hidden variables that are never absent. S then knows the rest only roughly at R's (o, a),
    so that only such a share of it is taken as helps. So it is with δ: where both domains do nearly
    the same, its noise is more than it corrects.
    """

    imitates_nominal = False
    scored_alone = True
    shift_shares = (1.0, 0.75, 0.5, 0.25, 0.0)
    outcome_shares = tuple(k / 10 for k in range(11))
    untried_share = UNTRIED

    def nominal_examples(self, sim: DomainSamples, real: DomainSamples) -> Examples:
        """Lessons of n: S's answer as it came out, whatever was hidden."""
        return Examples(sim.x, sim.change)

    def reference(
        self, nominal: Callable[[Tensor], Tensor], real: DomainSamples
    ) -> Float[Tensor, "row state"]:
        """The answer of n itself, since there is no answer with nothing hidden."""
        return nominal(real.x)


class Blend(Average):
    """``blend``: as ``mean``, beside a correction that reads S's answer."""

    has_reader = True


class Encoded(Read):
    """``encoded``: δ is added to S's answer and reads it; S itself encodes what is hidden.

    Where δ learns it, :attr:`DomainSamples.nominal` of R is what S would have answered, as
    :mod:`wt.train.answers` makes it of R's recording; in use S runs with its own hidden state, and
    its outcome is that answer. Nothing has to be imitated, and no linear map is left to be found.
    Without pairs nothing is translated, either: what S tells is in δ, and what is left of S and of
    R has nothing hidden that both have. Nearer to R as a distribution, it made four times the
    error on the R5.
    """

    has_nominal = False
    asks_simulator = True
    transported = False
    translates_unpaired = False
    alone = "S encodes, stepped again at estimates of what was hidden in R's recording"


class Ignored(SimulatorUse):
    """``ignored``: R's change is regressed on (o, a) alone."""

    has_nominal = False
    keeps_outcome = False

    def reference(
        self, nominal: Callable[[Tensor], Tensor], real: DomainSamples
    ) -> Float[Tensor, "row state"]:
        """Zero."""
        return torch.zeros_like(real.nominal)


class Absent(SimulatorUse):
    """No mean field: ``mean.kind: none``, as in the paper."""

    has_shift = False
    has_nominal = False


USES: dict[SimulatorUseName, SimulatorUse] = {
    "base": SimulatorUse(),
    "read": Read(),
    "mean": Average(),
    "blend": Blend(),
    "encoded": Encoded(),
    "ignored": Ignored(),
}


def use_of(settings: Mean) -> SimulatorUse:
    """The use that a configuration asks for."""
    return Absent() if settings.kind == "none" else USES[settings.simulator]
