"""δ learned of simulators around S, among which R is found by its recording.

Nobody has R's transitions with S's answer under what was hidden then. Of a *simulator* near S
(:mod:`wt.worlds.varied`) there are such pairs without end, since everything is known of it: S, set
to its hidden variables, answers its (o, a). So δ is learned of pairs of many such simulators, by
regressors g that also read by what factors the physics of each is off. What is left to be found in
R's recording is R's factors, a handful of numbers, and for these S's answers at *estimates* of
what was hidden (:mod:`wt.train.hidden`) do: other regressors g̃ learn what the simulators do beyond
S at such estimates, and R's factors are those with which g̃ foretells R best. What estimates are off
by is in g̃ as it is in R's own answers, so that it moves no factor.

Reality is not one of them. So where it pays on held-out transitions of R, the regressors go on from
g at R's factors with what g̃ leaves of R's recording. That dynamics are told apart by a few numbers,
found in use, is of Yu et al., "Preparing for the unknown" (2017).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float
from torch import Tensor, nn

from wt.config import Mean
from wt.nets.frame import Frame
from wt.nets.hidden_shift import FORCES
from wt.nets.mlp import CHUNK, Ensemble, in_chunks, mlp
from wt.nets.simulator_use import DomainSamples, Examples, use_of
from wt.nets.world_model import WorldModel
from wt.train.hidden import HiddenEstimator, Simulator
from wt.train.hidden_shift import Advancing, choose_gain, differences, learn
from wt.train.mean_field import samples
from wt.train.regression import (
    Progress,
    Regression,
    mean_square,
    member_seed,
    part_of,
    regress_on,
)
from wt.types import Transitions

LOCATED_BY = 20_000
"""Transitions of R that its factors are found by, evenly spread."""
WITHIN = 0.99
"""Share of what is left of R in a channel beyond whose size it is no larger, for what goes on."""
GOES_ON, FOR = 1 / 8, 1 / 4
"""Learning rate with which regressors go on, and steps, of those with which they were learned."""
WORTH = 0.2
"""Share of what is left of held-out transitions of R by which going on has to lower it.

Estimates of what was hidden err in R a little otherwise than in the simulators, which lowers it by
a twentieth to an eighth where R is one of them, and is not to be learned.
"""


@dataclass(frozen=True)
class Factors:
    """Logarithms of the factors of simulators around S, in units of their spread.

    Attributes:
        of: those of each lesson, (lesson, factor).
        least: of all of them, (factor,).
        most: likewise.
    """

    of: Float[Tensor, "lesson factor"]
    least: Float[Tensor, " factor"]
    most: Float[Tensor, " factor"]

    @classmethod
    def told(cls, log_factors: Float[np.ndarray, "lesson factor"]) -> Factors:
        """Of lessons that are told."""
        of = torch.tensor(log_factors / np.maximum(log_factors.std(axis=0), 1e-6))
        return cls(of, of.amin(dim=0), of.amax(dim=0))


class Family:
    """The simulators around S, what they do differently, and where R is among them.

    Attributes:
        regressions: number of those that :meth:`fit` takes.
    """

    def __init__(
        self, frame: Frame, settings: Mean, seed: int, simulator: Simulator, lessons: Transitions
    ) -> None:
        """Set up without data.

        Args:
            frame: with fitted normalisers; its δ is fitted in place.
            settings: size of the regressors, and budget.
            seed: same seed, same regressors.
            simulator: S.
            lessons: transitions of simulators around S, whose factors stand behind what is hidden
                (:func:`wt.worlds.varied.lessons_spec`).
        """
        self._frame, self._settings, self._simulator = frame, settings, simulator
        self._budget = Regression(settings.steps, settings.batch, settings.learning_rate, seed)
        n = len(frame.spec.hidden)
        self._lessons = replace(lessons, hidden=lessons.hidden[:, :n])
        self._factors = Factors.told(lessons.hidden[:, n:])
        self._estimator = HiddenEstimator(frame, self._network, self._budget)
        self.regressions = self._estimator.regressions + 3 * settings.members
        self.regressions += frame.hidden is not None

    def answered(self, real: Transitions) -> Transitions:
        """R's transitions, with S's answers at estimates in the place of its nominal ones."""
        return self._estimator.answered(real, self._simulator)

    def learn(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Learn what estimates of what was hidden take.

        Args:
            sim: transitions of S, with its hidden variables.
            real: transitions of R, of which the hidden variables are not read.
            progress: called with (done, total) steps, of all that is to come.
        """
        along = part_of(progress, 0, self.regressions * self._budget.steps)
        self._estimator.fit(sim, real, along, lessons=self._lessons)

    def fit(
        self,
        model: WorldModel,
        real: Transitions,
        held: Transitions,
        progress: Progress | None = None,
    ) -> None:
        """Fit δ and, where something hidden goes on, how it does.

        Args:
            model: that the frame is of.
            real: transitions of R, :meth:`answered`.
            held: likewise, which nothing is learned of.
            progress: called with (done, total) steps, as of :meth:`learn`.
        """
        turns = _Turns(progress, self._estimator.regressions, self.regressions, self._budget.steps)
        simulator, lessons = self._simulator, self._lessons
        answer = simulator.sim_step(lessons.o, lessons.a, lessons.hidden)
        exact = samples(self._frame, replace(lessons, nominal=answer))
        near = samples(self._frame, self._estimator.answered(lessons, simulator, "sim"))
        of_true, of_near = self._learned(exact, turns), self._learned(near, turns)
        of_real, of_held = samples(self._frame, real), samples(self._frame, held)
        spread = self._spread(of_near, near)
        factors = self._located(of_near, spread, of_real)
        seen, unseen = (_cut(_left(of_near, factors, x)) for x in (of_real, of_held))
        assert self._frame.shift is not None, "a mean field that asks S has a δ"
        for k, member in enumerate(self._frame.shift.members):
            _fold(of_true.members[k], factors, member)
            self._go_on(member, seen, unseen, k, turns.next())
        self._frame.requires_grad_(False)
        self._carry(model, held, factors, turns.next())

    def _network(self, inputs: int, outputs: int) -> nn.Module:
        return mlp(inputs, outputs, self._settings.width, self._settings.depth)

    def _learned(self, lessons: DomainSamples, turns: _Turns) -> Ensemble:
        """What simulators do beyond S's answer to lessons, by their factors."""
        inputs = self._inputs(lessons)
        target = lessons.change - lessons.nominal
        nets = [
            self._network(inputs.shape[1], target.shape[1]) for _ in range(self._settings.members)
        ]
        for k, net in enumerate(nets):
            budget = replace(self._budget, seed=member_seed(self._budget.seed, k))
            regress_on(net, inputs, target, budget, progress=turns.next())
        return Ensemble(nets).requires_grad_(False)

    def _inputs(self, lessons: DomainSamples) -> Float[Tensor, "lesson input"]:
        """(o, a), S's answer, and the factors of each simulator."""
        return torch.cat([lessons.x, lessons.nominal, self._factors.of], dim=1)

    def _spread(self, of_near: Ensemble, near: DomainSamples) -> Float[Tensor, " state"]:
        """Of what is left of lessons, in each channel."""
        left = near.change - near.nominal - in_chunks(of_near, self._inputs(near))
        return left.std(dim=0).clamp_min(1e-6)

    def _located(
        self, of_near: Ensemble, spread: Float[Tensor, " state"], real: DomainSamples
    ) -> Float[Tensor, " factor"]:
        """R's factors: the likeliest of what R did, among those that lessons have.

        Now and then S falls over at an estimate, so that errors are Cauchy's.
        """
        rows = torch.linspace(0, len(real.x) - 1, min(LOCATED_BY, len(real.x))).long()
        few = DomainSamples(real.x[rows], real.nominal[rows], real.change[rows])

        def misfit(values: Float[np.ndarray, " factor"]) -> tuple[float, np.ndarray]:
            at = torch.tensor(values, dtype=torch.float32, requires_grad=True)
            value = ((_left(of_near, at, few).target / spread) ** 2).log1p().mean()
            (slope,) = torch.autograd.grad(value, at)
            return float(value.detach()), slope.double().cpu().numpy()

        bounds = torch.stack([self._factors.least, self._factors.most], dim=1).cpu().numpy()
        found = scipy.optimize.minimize(
            misfit, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds
        )
        return torch.tensor(found.x, dtype=torch.float32)

    def _go_on(
        self, net: nn.Module, seen: Examples, unseen: Examples, k: int, progress: Progress | None
    ) -> None:
        """Let one regressor of δ take up what is left of R, where held-out R gains enough by it."""
        before = {name: values.clone() for name, values in net.state_dict().items()}
        with torch.no_grad():
            known, target = (
                Examples(x.inputs, x.target + in_chunks(net, x.inputs)) for x in (seen, unseen)
            )

        @torch.no_grad()
        def score() -> float:
            return float(mean_square(in_chunks(net, target.inputs) - target.target, 1.0))

        first = score()
        budget = replace(
            self._budget,
            steps=max(1, round(FOR * self._budget.steps)),
            learning_rate=GOES_ON * self._budget.learning_rate,
            seed=member_seed(self._budget.seed, k),
        )
        net.requires_grad_(True)
        regress_on(net, known.inputs, known.target, budget, progress=progress, score=score)
        if score() > (1 - WORTH) * first:
            net.load_state_dict(before)

    def _carry(
        self,
        model: WorldModel,
        held: Transitions,
        factors: Float[Tensor, " factor"],
        progress: Progress | None,
    ) -> None:
        """Learn how hidden variables go on in the simulators beyond S's, and take R's factors."""
        shift, simulator, lessons = model.frame.hidden, self._simulator, self._lessons
        if shift is None or not isinstance(simulator, Advancing):
            return
        if not self._estimator.told.any():
            return
        given = simulator, lessons, lessons.hidden, self._estimator.told
        known = differences(model.frame, shift, *given)
        if known is None:
            return
        inputs = torch.cat([known.inputs, self._factors.of[torch.tensor(known.rows)]], dim=1)
        net = self._network(inputs.shape[1], known.target.shape[1])
        learn(net, known._replace(inputs=inputs), self._budget, progress)
        _fold(net, factors, shift.net)
        choose_gain(model, shift, self._estimator, simulator, held)


def family_of(
    frame: Frame,
    settings: Mean,
    seed: int,
    simulator: Simulator | None,
    lessons: Transitions | None,
) -> Family | None:
    """The simulators around S, where a mean field asks S and there are any; else None.

    Forces are told by outcomes alone, in R of another size than in S, so that those of simulators
    around S say nothing of R's.

    Args:
        frame: with fitted normalisers.
        settings: use of the simulator, and budget.
        seed: same seed, same regressors.
        simulator: S.
        lessons: transitions of simulators around S.
    """
    if not use_of(settings).asks_simulator or simulator is None or lessons is None:
        return None
    if any(channel.unit in FORCES for channel in frame.spec.hidden):
        return None
    return Family(frame, settings, seed, simulator, lessons)


class _Turns:
    """Regressions of one number of steps, one after the other, as parts of all of them."""

    def __init__(self, progress: Progress | None, done: int, total: int, steps: int) -> None:
        self._progress, self._done, self._total, self._steps = progress, done, total, steps

    def next(self) -> Progress | None:
        """Progress of the one that comes next."""
        begin = self._done * self._steps
        self._done += 1
        return part_of(self._progress, begin, self._total * self._steps)


def _left(ensemble: Ensemble, factors: Float[Tensor, " factor"], real: DomainSamples) -> Examples:
    """(o, a) and S's answer at estimates, and what a simulator of these factors leaves of R."""
    inputs = torch.cat([real.x, real.nominal], dim=1)

    def foretold(rows: Tensor) -> Tensor:
        return ensemble(torch.cat([rows, factors.expand(len(rows), -1)], dim=1))

    answers = torch.cat([foretold(part) for part in inputs.split(CHUNK)])
    return Examples(inputs, real.change - real.nominal - answers)


def _cut(examples: Examples) -> Examples:
    """Examples whose answers are no larger than most: where S fell over, they say nothing."""
    sizes = examples.target.abs()
    most = sizes.kthvalue(max(1, round(WITHIN * len(sizes))), dim=0).values
    return examples._replace(target=examples.target.clamp(-most, most))


@torch.no_grad()
def _fold(net: nn.Module, factors: Float[Tensor, " factor"], into: nn.Module) -> None:
    """Make one network another, whose last inputs are constant: they go into its first bias."""
    (name, weight), *rest = net.state_dict().items()
    read = weight.shape[1] - len(factors)
    state = {name: weight[:, :read], **dict(rest)}
    bias = name.replace("weight", "bias")
    state[bias] = state[bias] + weight[:, read:] @ factors
    into.load_state_dict(state)
