"""What S would have answered to R's transitions, made of recordings alone.

Who translates S's outcome learns from (o, a, o′ of S) and o′ of R, and nobody has R's transitions
with S's answer under what was hidden then. S at an *estimate* of that (:mod:`wt.train.hidden`) is
not it: estimates are off, and of some things there are none. No recording says where on a field of
blocks a robot stood, so that S at the estimate stands on other ground; a regression on its answers
learns to take back what S says of the ground, of which in use S says what is true.

But what either domain does on average, where S answers so at an estimate, is known from its own
recording. S would have answered what it does on average then; and, beyond it, either nothing, which
is right where S tells no more than the recording does, or what R did beyond R's average, which is
right where what is hidden does to R what it does to S. Which of them is, no recording tells, so
that every other transition has the one, and the rest has the other.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from wt.config import Mean
from wt.errors import ConfigError
from wt.nets.frame import Frame
from wt.nets.mlp import in_chunks, mlp
from wt.nets.simulator_use import DomainSamples, use_of
from wt.nets.world_model import WorldModel
from wt.train.hidden import HiddenEstimator, Network, Simulator
from wt.train.hidden_shift import Advancing, fit_hidden_shift
from wt.train.mean_field import samples
from wt.train.regression import Progress, Regression, part_of, regress_on
from wt.train.selection import Selection, Unpaired
from wt.types import Domain, Transitions

SHARES = (0.0, 1.0)
"""Of what R did beyond its average, in one transition after the other."""


class Answers:
    """Answers of S to R's transitions, which a translation of S's outcome is learned from."""

    def __init__(
        self,
        frame: Frame,
        network: Network,
        budget: Regression,
        simulator: Simulator,
        lessons: Transitions | None = None,
    ) -> None:
        """Set up without data.

        Args:
            frame: with fitted normalisers.
            network: makes the regressors.
            budget: of each regression.
            simulator: S.
            lessons: transitions of simulators around S, which estimates learn from, too.
        """
        self._frame, self._network, self._budget = frame, network, budget
        self._simulator, self._lessons = simulator, lessons
        self._estimator = HiddenEstimator(frame, network, budget)

    @property
    def regressions(self) -> int:
        """Number of regressions that :meth:`fit` takes: none where nothing is hidden."""
        estimated = self._estimator.regressions
        return estimated + 2 if estimated else 0

    def fit(
        self, sim: Transitions, real: Transitions, progress: Progress | None = None
    ) -> Transitions:
        """Learn what estimates take, and what either domain does on average where S is at them.

        Args:
            sim: transitions of S, with its hidden variables.
            real: transitions of R, of which the hidden variables are not read.
            progress: called with (done, total) steps.

        Returns:
            :meth:`of` R's transitions, about which S is not asked twice.
        """
        steps = self._budget.steps
        done, total = self._estimator.regressions * steps, self.regressions * steps
        along = part_of(progress, 0, total)
        self._estimator.fit(sim, real, along, lessons=self._lessons)
        if not self.regressions:
            return self.of(real)
        at = self._at_estimates(sim, "sim")
        self._sim = self._average(at, part_of(progress, done, total))
        at = self._at_estimates(real, "real")
        self._real = self._average(at, part_of(progress, done + steps, total))
        return self._would(real, at)

    def of(self, real: Transitions) -> Transitions:
        """R's transitions, with what S would have answered in the place of its nominal answers.

        Args:
            real: ordered by episode and step; their hidden variables are not read.
        """
        if not self.regressions:
            return self._estimator.answered(real, self._simulator)
        return self._would(real, self._at_estimates(real, "real"))

    def carry(
        self,
        model: WorldModel,
        real: Transitions,
        held: Transitions,
        progress: Progress | None = None,
    ) -> None:
        """Learn how R's hidden variables go on beyond S's, where S says how its own do.

        Args:
            model: with a fitted mean field; its difference of hidden variables is fitted in place.
            real: transitions of R, as :meth:`fit` had them.
            held: transitions of R that nothing is learned from.
            progress: called with (done, total) steps.
        """
        shift, simulator = model.frame.hidden, self._simulator
        if shift is not None and isinstance(simulator, Advancing):
            given = self._estimator, simulator, real, held, self._budget
            fit_hidden_shift(model, shift, *given, progress)

    @torch.no_grad()
    def _would(self, real: Transitions, at: DomainSamples) -> Transitions:
        """R's transitions, with what S would have answered, from its answers at estimates."""
        inputs = _inputs(at)
        beyond = at.change - at.nominal - in_chunks(self._real, inputs)
        turns = torch.arange(len(real)) % len(SHARES)
        share = torch.tensor(SHARES)[turns][:, None]
        would = at.nominal + in_chunks(self._sim, inputs) + share * beyond
        states = self._frame.next_states(torch.tensor(real.o), would)
        return replace(real, nominal=states.cpu().numpy())

    def _average(self, at: DomainSamples, progress: Progress | None) -> nn.Module:
        """What a domain does on average beyond S's answer at estimates of what was hidden."""
        inputs, difference = _inputs(at), at.change - at.nominal
        net = self._network(inputs.shape[1], difference.shape[1])
        regress_on(net, inputs, difference, self._budget, progress=progress)
        return net

    def _at_estimates(self, data: Transitions, domain: Domain) -> DomainSamples:
        return samples(self._frame, self._estimator.answered(data, self._simulator, domain))


def answers_of(
    frame: Frame,
    settings: Mean,
    seed: int,
    simulator: Simulator | None,
) -> Answers | None:
    """What S would have answered, for a mean field that asks; None for one that does without.

    Args:
        frame: with fitted normalisers.
        settings: use of the simulator, and budget.
        seed: same seed, same answers.
        simulator: S.

    Raises:
        ConfigError: there is no simulator to ask.
    """
    if not use_of(settings).asks_simulator:
        return None
    if simulator is None:
        raise ConfigError("mean.simulator encoded steps the simulator, and was given none")
    budget = Regression(settings.steps, settings.batch, settings.learning_rate, seed)

    def network(inputs: int, outputs: int) -> nn.Module:
        return mlp(inputs, outputs, settings.width, settings.depth)

    return Answers(frame, network, budget, simulator)


def with_answers(
    answers: Answers,
    sim: Transitions,
    real: Transitions,
    selection: Selection,
    progress: Progress | None,
) -> tuple[Transitions, Selection]:
    """R's transitions with what S would have answered, held-out ones too.

    Args:
        answers: not fitted yet.
        sim: transitions of S.
        real: transitions of R.
        selection: held-out data; pairs have answers already.
        progress: called with (done, total) steps.
    """
    answered = answers.fit(sim, real, progress)
    if isinstance(selection, Unpaired):
        selection = Unpaired(selection.sim, answers.of(selection.real))
    return answered, selection


def _inputs(at: DomainSamples) -> Tensor:
    """(o, a) and S's answer."""
    return torch.cat([at.x, at.nominal], dim=1)
