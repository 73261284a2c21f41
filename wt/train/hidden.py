"""What was hidden in R, estimated from R's own recording by regressors that S teaches.

S knows what is hidden in it: its own transitions, beside its own hidden variables, are lessons in
what a recording tells of them. What they teach is then read off R's recording, which needs nothing
that a robot does not log; what R's collection knows of its hidden variables is never looked at.
Either kind of hidden variable shows in its own way:

``motion``  where and how fast something moves that no sensor sees (a trunk, a load). It persists,
            so a stretch of the recording before and *after* the step tells it, as a smoother does:
            legs that stand give the trunk's velocity away (leg odometry, but learned). It is also
            learned from simulators around S, where there are any (:mod:`wt.worlds.varied`), so
            that what holds in S alone is not.
``force``   a force or torque from outside may be another at every step, and shows in the outcome of
            its own alone: in what is left of it beyond the most frequent answer to (o, a), as in
            the residual of inverse dynamics. Heavier links and softer drives change its effect:
            what is left of R's outcome is moved to the size that S's has by closed-form
            transport. So forces are taken to be of one distribution in both domains.

An estimate is off, and an input that is off flattens a regression on it. One that is off from the
truth at random does (a measurement), one from which the truth is off at random does not (Berkson
1950). A regressor's answer is of the second sort, a conditional mean, as far as R resembles S.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from torch import Tensor, nn

from wt.data.stored import transitions
from wt.data.transitions import join
from wt.losses.robust import cauchy
from wt.nets.frame import Frame
from wt.nets.hidden_shift import FORCES
from wt.nets.mlp import CHUNK, in_chunks
from wt.train.mean_field import gaussian_transport, samples
from wt.train.regression import Progress, Regression, member_seed, part_of, regress, regress_on
from wt.types import Domain, Transitions

AROUND = 6
"""Control steps before and after a transition in which the motion of what is hidden shows."""
TOLD = 0.05
"""Share of a motion's variance that a recording has to tell, linearly, for it to be estimated."""
MODE_WIDTH = 0.05
"""Width of the loss that finds the most frequent answer, as ``mean.mode_width``."""
RIDGE = 1e-2
"""Of that linear regression, in units of the variance of its inputs."""
LOOKED_AT = 20_000
"""Transitions that it looks at; of every four it is fitted to the first three."""

Network = Callable[[int, int], nn.Module]
"""(inputs, outputs) → an untrained network."""


@runtime_checkable
class Simulator(Protocol):
    """S, for what steps it again; every :class:`wt.worlds.base.World` is one."""

    def sim_step(
        self,
        o: Float[np.ndarray, "sample obs"],
        a: Float[np.ndarray, "sample action"],
        hidden: Float[np.ndarray, "sample hidden"] | None,
    ) -> Float32[np.ndarray, "sample state"]:
        """S's answer to (o, a) under a hidden variable; None for nothing hidden."""
        ...

    def answers(self, real: Transitions) -> Float32[np.ndarray, "transition state"]:
        """S's answers to R's transitions under what was hidden then."""
        ...


class HiddenEstimator:
    """Estimates of the hidden variables of R's transitions."""

    def __init__(self, frame: Frame, network: Network, budget: Regression) -> None:
        """Set up without data.

        Args:
            frame: with fitted normalisers.
            network: makes the regressors.
            budget: of each regression.
        """
        units = [channel.unit for channel in frame.spec.hidden]
        force = np.array([unit in FORCES for unit in units], bool)
        kinds: tuple[type[_Estimator], ...] = (_Motion, _Force)
        self._width = len(units)
        self._parts = [
            kind(np.flatnonzero(chosen), frame, network, budget)
            for kind, chosen in zip(kinds, (~force, force), strict=True)
            if chosen.any()
        ]

    @property
    def regressions(self) -> int:
        """Number of regressions that :meth:`fit` takes."""
        return sum(part.regressions for part in self._parts)

    @property
    def told(self) -> Bool[np.ndarray, " hidden"]:
        """Variables that go on, and of which a recording tells something."""
        out = np.zeros(self._width, bool)
        for part in self._parts:
            out[part.channels] = part.told
        return out

    def fit(
        self,
        sim: Transitions,
        real: Transitions,
        progress: Progress | None = None,
        *,
        lessons: Transitions | None = None,
    ) -> None:
        """Learn from S, and from R's observable transitions.

        Args:
            sim: transitions of S, with its hidden variables.
            real: transitions of R, of which the hidden variables are not read.
            progress: called with (done, total) steps.
            lessons: transitions of simulators around S, with theirs; motion is also read off these.
        """
        real, done = _observable(real), 0
        for part in self._parts:
            steps = part.budget.steps
            taught = part.taught(sim, lessons)
            part.fit(taught, real, part_of(progress, done, self.regressions * steps))
            done += part.regressions * steps

    def estimate(
        self, data: Transitions, domain: Domain = "real"
    ) -> Float32[np.ndarray, "transition hidden"] | None:
        """Hidden variables of transitions; None where nothing is hidden.

        Args:
            data: ordered by episode and step; their hidden variables are not read.
            domain: whose they are.
        """
        if not self._parts:
            return None
        data = _observable(data)
        out = np.zeros((len(data), self._width), np.float32)
        for part in self._parts:
            out[:, part.channels] = part.estimate(data, domain)
        return out

    def answered(
        self, data: Transitions, simulator: Simulator, domain: Domain = "real"
    ) -> Transitions:
        """Transitions with S's answers at estimates of what was hidden for the nominal ones.

        Args:
            data: ordered by episode and step; their hidden variables are not read.
            simulator: S.
            domain: whose transitions they are.
        """
        answers = simulator.sim_step(data.o, data.a, self.estimate(data, domain))
        return replace(data, nominal=answers)


class _Estimator(ABC):
    """Estimates some channels of the hidden variables.

    Attributes:
        channels: their indices.
        told: those of them that go on, and of which a recording tells something.
        budget: of each regression.
        regressions: number of these.
    """

    regressions: int

    def __init__(
        self,
        channels: Int[np.ndarray, " channel"],
        frame: Frame,
        network: Network,
        budget: Regression,
    ) -> None:
        self.channels, self.budget = channels, budget
        self.told = np.zeros(len(channels), bool)
        self._frame, self._network = frame, network

    def taught(self, sim: Transitions, lessons: Transitions | None) -> Transitions:
        """Transitions to learn from, of S's and those of simulators around it."""
        return sim

    @abstractmethod
    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Learn from S, and from what R's transitions show."""

    @abstractmethod
    def estimate(self, data: Transitions, domain: Domain) -> Float32[np.ndarray, "row channel"]:
        """The channels of a domain's transitions, physical units."""

    def _lessons(self, sim: Transitions) -> Tensor:
        """S's own hidden variables, normalised; a channel that never moves stays zero."""
        hidden = torch.tensor(sim.hidden[:, self.channels])
        self._mean, self._spread = hidden.mean(dim=0), hidden.std(dim=0)
        return (hidden - self._mean) / self._spread.clamp_min(1e-6)

    @torch.no_grad()
    def _physical(self, normalised: Tensor) -> Float32[np.ndarray, "row channel"]:
        out: np.ndarray = (normalised * self._spread + self._mean).cpu().numpy()
        return out


class _Motion(_Estimator):
    """Motion, from the robot's own motion some steps before and after."""

    regressions = 1

    def taught(self, sim: Transitions, lessons: Transitions | None) -> Transitions:
        """All of them: R's drives, friction and masses are not S's either."""
        if lessons is None:
            return sim
        # behind what is hidden in S, too, stand the factors of each simulator
        as_of_s = replace(lessons, hidden=lessons.hidden[:, : sim.hidden.shape[1]])
        return transitions(join([sim, as_of_s]))

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Regress S's hidden motion on stretches of S's transitions."""
        window = _Window(*self._shown(sim), _around(sim))
        hidden = self._lessons(sim)
        told = _told(window, hidden)
        self.told = told.cpu().numpy() > 0
        self._spread = self._spread * told
        target = hidden * told
        self._net = self._network(window.size, len(self.channels))

        def error(rows: Tensor) -> Tensor:
            out: Tensor = self._net(window(rows)) - target[rows]
            return out

        regress(self._net, error, len(target), self.budget, progress=progress)

    @torch.no_grad()
    def estimate(self, data: Transitions, domain: Domain) -> Float32[np.ndarray, "row channel"]:
        """What S has taught, of stretches of the transitions."""
        window = _Window(*self._shown(data), _around(data))
        rows = torch.arange(len(data)).split(CHUNK)
        return self._physical(torch.cat([self._net(window(part)) for part in rows]))

    def _shown(self, data: Transitions) -> tuple[Tensor, Tensor]:
        """Each step's state and action, and its outcome, which ends an episode."""
        spec = self._frame.spec
        x, _, change = samples(self._frame, data)
        return torch.cat([x[:, : spec.n_state], x[:, -spec.n_action :]], dim=1), change


class _Force(_Estimator):
    """Forces, from what is left of an outcome beyond the most frequent one."""

    regressions = 2

    def fit(self, sim: Transitions, real: Transitions, progress: Progress | None) -> None:
        """Find what R does most often, move what is left to S's size, and regress S's forces."""
        steps = self.budget.steps
        x, nominal, change = samples(self._frame, real)
        difference = change - nominal
        self._shift = self._network(x.shape[1], difference.shape[1])

        def mode(error: Tensor, _: float) -> Tensor:
            return cauchy(error, MODE_WIDTH)

        along = part_of(progress, 0, 2 * steps)
        regress_on(self._shift, x, difference, self.budget, mode, along)
        of_sim, nominal, change = samples(self._frame, sim)
        left = change - nominal
        self._transport = gaussian_transport(self._left(x, difference), left)
        inputs, target = torch.cat([of_sim, left], dim=1), self._lessons(sim)
        self._net = self._network(inputs.shape[1], len(self.channels))
        regress_on(
            self._net,
            inputs,
            target,
            replace(self.budget, seed=member_seed(self.budget.seed, 1)),
            progress=part_of(progress, steps, 2 * steps),
        )

    @torch.no_grad()
    def estimate(self, data: Transitions, domain: Domain) -> Float32[np.ndarray, "row channel"]:
        """What S has taught, of outcomes; R's are moved to where S's are."""
        x, nominal, left = samples(self._frame, data)
        left = left - nominal
        if domain == "real":
            left = self._left(x, left) @ self._transport
        return self._physical(in_chunks(self._net, torch.cat([x, left], dim=1)))

    @torch.no_grad()
    def _left(self, x: Tensor, difference: Tensor) -> Tensor:
        """What R does differently from the simulator, without what it does so most often."""
        return difference - in_chunks(self._shift, x)


class _Window:
    """Stretches of a recording as a regressor reads them, gathered when they are asked for."""

    def __init__(
        self,
        shown: Float[Tensor, "row channel"],
        outcome: Float[Tensor, "row state"],
        index: Int[Tensor, "row around"],
    ) -> None:
        self._shown, self._outcome, self._index = shown, outcome, index
        self.size = index.shape[1] * shown.shape[1] + outcome.shape[1]

    def __len__(self) -> int:
        return len(self._outcome)

    def __call__(self, rows: Int[Tensor, " batch"]) -> Float[Tensor, "batch input"]:
        stretch = self._shown[self._index[rows]].flatten(1)
        return torch.cat([stretch, self._outcome[rows]], dim=1)


def _around(data: Transitions) -> Int[Tensor, "row around"]:
    """Rows from :data:`AROUND` before to as many after each; the episode's ends stand for more."""
    row = np.arange(len(data))
    goes_on = (np.diff(data.episode) == 0) & (np.diff(data.step) == 1)
    first = np.flatnonzero(np.append(True, ~goes_on))
    last = np.append(first[1:], len(data)) - 1
    run = np.searchsorted(first, row, side="right") - 1
    index = row[:, None] + np.arange(-AROUND, AROUND + 1)
    return torch.tensor(np.clip(index, first[run][:, None], last[run][:, None]))


def _told(window: _Window, hidden: Float[Tensor, "row channel"]) -> Float[Tensor, " channel"]:
    """1 for channels of which a recording tells something, 0 for others, as where a robot stands.

    Of the latter a network would learn by heart what is not to be known.
    """
    rows = torch.linspace(0, len(window) - 1, min(len(window), LOOKED_AT)).long()
    fitted, held = rows[: 3 * len(rows) // 4], rows[3 * len(rows) // 4 :]
    x = window(fitted).double()
    gram = x.T @ x + RIDGE * len(x) * torch.eye(x.shape[1], dtype=x.dtype)
    weights = torch.linalg.solve(gram, x.T @ hidden[fitted].double())
    left = hidden[held].double() - window(held).double() @ weights
    of_all = ((hidden[held].double()) ** 2).mean(dim=0).clamp_min(1e-12)
    return ((left**2).mean(dim=0) < (1 - TOLD) * of_all).to(hidden.dtype)


def _observable(data: Transitions) -> Transitions:
    """Transitions as a robot logs them, so that nothing below can look at what is hidden."""
    return replace(data, hidden=np.full_like(data.hidden, np.nan))
