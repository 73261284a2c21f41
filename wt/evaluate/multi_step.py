"""Multi-step rollouts: every method on its own predictions, the policy acting on them (figure 4).

A rollout starts from a state of R and goes on without it. Each step, the policy acts on the last
prediction, the simulator takes that action, the method makes of its answer the next prediction,
and the simulator's observable state is overwritten with it; what is hidden (where the trunk is,
how fast it moves, where a ball rolls) stays as the simulator left it. Methods without a simulator
of their own are given the same one as a body, so that it can be seen where they end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from wt.baselines.base import Baseline
from wt.config import Alignment, FitConfig
from wt.evaluate.alignment import align
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.nets.world_model import WorldModel
from wt.translate import carried, translated
from wt.types import Domain, Pairs, Transitions
from wt.worlds.closed_loop import ClosedLoop, ReferenceRollouts

_STILL = 1e-12
"""Amplitude of predictions that are all the same, but for rounding."""


@dataclass(frozen=True)
class Now:
    """All that a method may look at when it predicts.

    Attributes:
        o: the observations up to the present one; R's own before the start, then predicted ones.
        a: the actions that followed them.
        sim_next: the simulator's answer to the last of them.
    """

    o: Float[np.ndarray, "robot time obs"]
    a: Float[np.ndarray, "robot time action"]
    sim_next: Float[np.ndarray, "robot state"]


Step = Callable[[Now], np.ndarray]
"""A method: the next state, (N, n_state)."""


@runtime_checkable
class Carrying(Protocol):
    """A method that also says what is hidden after the step; of others, S's own goes on."""

    def hidden(
        self,
        now: Now,
        before: Float[np.ndarray, "robot hidden"],
        after: Float[np.ndarray, "robot hidden"],
    ) -> Float[np.ndarray, "robot hidden"]:
        """Hidden variables after the step.

        Args:
            now: what the step's prediction was made of.
            before: hidden variables before the step.
            after: S's after it.
        """
        ...


@dataclass(frozen=True)
class Paths:
    """Where rollouts of one method went.

    Attributes:
        states: state channels after each step, physical units; of a rollout that has diverged,
            where it began.
        gone: who has left the bounds, then or before.
    """

    states: Float[np.ndarray, "robot horizon state"]
    gone: Bool[np.ndarray, "robot horizon"]


@dataclass(frozen=True)
class Rolled:
    """Rollouts of one method, compared with R's.

    Attributes:
        mse: squared error of the normalised state, mean over channels and over the rollouts that
            have not diverged; NaN once all have.
        rmse: root mean squared error of each channel over the same rollouts, physical units.
        diverged: share of rollouts that have left the bounds.
        amplitude: variance of the predictions over these rollouts in units of that of R's states,
            normalised and summed over channels; 1 for a method that goes on as lively as R.
        correlation: of both, likewise; of predictions that are a mean, its square is the amplitude.
    """

    mse: Float[np.ndarray, " horizon"]
    rmse: Float[np.ndarray, "horizon state"]
    diverged: Float[np.ndarray, " horizon"]
    amplitude: Float[np.ndarray, " horizon"]
    correlation: Float[np.ndarray, " horizon"]


def roll_out(
    world: ClosedLoop,
    truth: ReferenceRollouts,
    step: Step,
    scale: Float[np.ndarray, " state"],
    alignment: Alignment = "state",
    true_hidden: bool = False,
) -> Rolled:
    """Run a method on its own predictions and compare with what R did: :func:`follow`, scored."""
    return score(follow(world, truth, step, scale, alignment, true_hidden), truth, scale)


def follow(
    world: ClosedLoop,
    truth: ReferenceRollouts,
    step: Step,
    scale: Float[np.ndarray, " state"],
    alignment: Alignment = "state",
    true_hidden: bool = False,
    domain: Domain = "sim",
) -> Paths:
    """Run a method on its own predictions.

    Args:
        world: policy, simulator and bounds.
        truth: what R did from the same starts on.
        step: the method.
        scale: what errors are measured in.
        alignment: how the simulator follows the method; see :mod:`wt.evaluate.alignment`.
        true_hidden: the simulator's hidden state is R's own at every step, not at the start alone.
        domain: whose simulator answers; of ``real`` :func:`simulator` is R itself.
    """
    n, past = world.spec.n_state, truth.past
    o, hidden = truth.o[:, : past + 1], truth.hidden[:, past]
    a = truth.a[:, :past]
    lost = np.zeros(len(truth), bool)
    states = np.empty((len(truth), truth.horizon, n), np.float32)
    gone = np.empty(states.shape[:2], bool)
    for k in range(truth.horizon):
        action = world.act(o[:, -1], truth.context[:, past + k]).astype(np.float32)
        a = np.concatenate([a, action[:, None]], axis=1)
        before = truth.hidden[:, past + k] if true_hidden else hidden
        taken = _WorldStep(world, domain, o[:, -1], action, before)
        now = Now(o, a, taken.state)
        with np.errstate(over="ignore", invalid="ignore"):
            target = step(now)
            if isinstance(step, Carrying):
                taken.hidden = step.hidden(now, before, taken.hidden)
        align(taken, target, alignment, scale)
        state, hidden = taken.state, taken.hidden
        lost |= world.astray(state, hidden)
        # who is gone waits where it began, so that nothing explodes
        state[lost], hidden[lost] = truth.o[lost, past, :n], truth.hidden[lost, past]
        o = np.concatenate([o, np.hstack([state, action])[:, None]], axis=1)[:, -(past + 1) :]
        a = a[:, -past:] if past else a[:, :0]
        states[:, k], gone[:, k] = state, lost
    return Paths(states, gone)


def still(truth: ReferenceRollouts, state: Float[np.ndarray, " state"]) -> Paths:
    """The prediction of one state for ever, which nothing leads to."""
    shape = len(truth), truth.horizon
    return Paths(np.broadcast_to(state, (*shape, len(state))), np.zeros(shape, bool))


def middle(several: Sequence[Paths]) -> Paths:
    """The mean of rollouts from the same starts; gone is who is in any of them."""
    states = np.mean([paths.states for paths in several], axis=0)
    return Paths(states, np.any([paths.gone for paths in several], axis=0))


def score(paths: Paths, truth: ReferenceRollouts, scale: Float[np.ndarray, " state"]) -> Rolled:
    """Compare rollouts with what R did.

    Args:
        paths: of the method.
        truth: of R, from the same starts.
        scale: what errors are measured in.
    """
    n, horizon = paths.states.shape[2], truth.horizon
    square = np.full((horizon, n), np.nan)
    amplitude, correlation = np.full(horizon, np.nan), np.full(horizon, np.nan)
    for k in range(horizon):
        left = ~paths.gone[:, k]
        if not left.any():
            continue
        predicted = paths.states[left, k].astype(np.float64)
        real = truth.o[left, truth.past + k + 1, :n]
        square[k] = np.mean((predicted - real) ** 2, axis=0)
        ours, theirs = ((x - x.mean(axis=0)) / scale for x in (predicted, real))
        own, of_real, both = (np.sum(x * y) for x, y in ((ours, ours), (theirs, theirs),
                                                         (ours, theirs)))  # fmt: skip
        if of_real > 0:
            amplitude[k] = own / of_real
        if own > _STILL * of_real:
            correlation[k] = both / np.sqrt(own * of_real)
    diverged = paths.gone.mean(axis=0)
    mse = (square / scale**2).mean(axis=1)
    return Rolled(mse, np.sqrt(square), diverged, amplitude, correlation)


class _WorldStep:
    """One step of a functional world, as :func:`align` changes it.

    Attributes:
        action: under which it was taken, (N, n_action).
        state: state channels where it ends, (N, n_state).
        hidden: hidden variables there, (N, n_hidden).
    """

    def __init__(
        self,
        world: ClosedLoop,
        domain: Domain,
        o: Float[np.ndarray, "robot obs"],
        action: Float[np.ndarray, "robot action"],
        hidden: Float[np.ndarray, "robot hidden"],
    ) -> None:
        """Take the step from observations and hidden variables."""
        self._advance = lambda a: world.advance(domain, o, a, hidden)
        self._stance = world.stance
        self.action = action
        self.state, self.hidden = self._advance(action)

    def end_state(
        self, action: Float[np.ndarray, "robot action"]
    ) -> Float[np.ndarray, "robot state"]:
        """As :class:`wt.evaluate.alignment.SimulatorStep`."""
        return self._advance(action)[0]

    def overwrite(self, target: Float[np.ndarray, "robot state"], keep_stance: bool) -> None:
        """As :class:`wt.evaluate.alignment.SimulatorStep`."""
        if keep_stance:
            self.hidden = self._stance(self.state, target, self.hidden)
        self.state = target

    def retake(self, action: Float[np.ndarray, "robot action"]) -> None:
        """As :class:`wt.evaluate.alignment.SimulatorStep`."""
        self.state, self.hidden = self._advance(action)


def alignment_of(config: FitConfig, method: str) -> Alignment:
    """The alignment of a method of a run: as its settings say, and ``state`` for a baseline."""
    settings = {PAPERS_OWN: config.paper, OURS: config.plus}.get(method)
    return settings.translation.alignment if settings else "state"


def simulator(now: Now) -> Float[np.ndarray, "robot state"]:
    """RawSim: the simulator's answer as it is."""
    return now.sim_next.copy()


def of_model(model: WorldModel, carry: bool = True) -> Step:
    """World Translation: the simulator's answer translated, and what is hidden carried on.

    Args:
        model: a trained model.
        carry: whether it says how hidden variables go on; else they go on as S's.
    """
    step = _Translated(model)
    return step if carry else lambda now: step(now)


class _Translated:
    def __init__(self, model: WorldModel) -> None:
        self._model = model

    def __call__(self, now: Now) -> Float[np.ndarray, "robot state"]:
        """See :data:`Step`."""
        return translated(self._model, now.o[:, -1], now.a[:, -1], now.sim_next)

    def hidden(
        self,
        now: Now,
        before: Float[np.ndarray, "robot hidden"],
        after: Float[np.ndarray, "robot hidden"],
    ) -> Float[np.ndarray, "robot hidden"]:
        """See :class:`Carrying`."""
        return carried(self._model, now.o[:, -1], now.a[:, -1], now.sim_next, before, after)


class _Disturbed:
    def __init__(self, step: Step, errors: Float[np.ndarray, "pair state"], seed: int) -> None:
        self._step, self._errors, self._rng = step, errors, np.random.default_rng(seed)

    def __call__(self, now: Now) -> Float[np.ndarray, "robot state"]:
        """See :data:`Step`."""
        drawn = self._errors[self._rng.integers(len(self._errors), size=len(now.o))]
        return np.asarray(self._step(now) + drawn, np.float32)

    def hidden(
        self,
        now: Now,
        before: Float[np.ndarray, "robot hidden"],
        after: Float[np.ndarray, "robot hidden"],
    ) -> Float[np.ndarray, "robot hidden"]:
        """See :class:`Carrying`."""
        return self._step.hidden(now, before, after) if isinstance(self._step, Carrying) else after


def disturbed(step: Step, errors: Float[np.ndarray, "pair state"], seed: int) -> Step:
    """A method off by as much at every step as it is known to err, drawn anew for each robot.

    Args:
        step: the method.
        errors: of single steps, to draw from, physical units.
        seed: of the draws.
    """
    return _Disturbed(step, errors, seed)


def of_baseline(baseline: Baseline, world: ClosedLoop) -> Step:
    """A baseline, which sees the rollout so far as its history."""
    n = world.spec.n_state

    def step(now: Now) -> Float[np.ndarray, "robot state"]:
        count, time = now.o.shape[:2]
        last = np.zeros((count, time), bool)
        last[:, -1] = True
        flat = last.reshape(-1)

        def rows(values: Float[np.ndarray, "robot time _"]) -> Float[np.ndarray, "row _"]:
            return np.ascontiguousarray(values).reshape(count * time, -1)

        # of the present step the outcome is what is asked for: its own state stands there
        after = rows(np.concatenate([now.o[:, 1:, :n], now.o[:, -1:, :n]], axis=1))
        nominal, answer = after.copy(), after.copy()
        nominal[flat] = world.sim_step(now.o[:, -1], now.a[:, -1], None)
        answer[flat] = now.sim_next
        index = np.arange(count * time)
        past = Transitions(
            o=rows(now.o), a=rows(now.a), s_next=after, nominal=nominal,
            hidden=np.empty((count * time, 0)), episode=index // time, step=index % time,
        )  # fmt: skip
        return baseline.predict(Pairs(past, answer))[flat]

    return step
