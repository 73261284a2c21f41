"""Fit how R's hidden variables go on beyond S's: from R's own recording, and nothing else.

R's recording before and after a step tells of its hidden variables what S has taught
(:mod:`wt.train.hidden`). S is set to them at one step, takes it, and is off at the next: that is
the difference to learn. Estimates at both steps err, so that all of it is too much. The shares that
are applied are those with which S and the translation, left to themselves for :data:`HORIZON` steps
under the actions that R was given, stay nearest to what R's held-out recording says: no pairs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from torch import Tensor, nn

from wt.nets.frame import Frame
from wt.nets.hidden_shift import HiddenShift
from wt.nets.world_model import WorldModel
from wt.train.hidden import HiddenEstimator
from wt.train.regression import Progress, Regression, member_seed, regress
from wt.translate import carried, translated
from wt.types import Domain, Transitions

HORIZON, STARTS = 25, 256
"""Steps of the rollouts that choose the shares, and their number at most."""
GAINS, OF_ONE = tuple(k / 8 for k in range(9)), (0.0, 0.5, 1.0)
"""Shares that are tried for all variables together, and then for one after the other."""


@runtime_checkable
class Advancing(Protocol):
    """S, where it says what is hidden after a step; see ``wt.worlds.closed_loop.ClosedLoop``."""

    def advance(
        self,
        domain: Domain,
        o: Float[np.ndarray, "robot obs"],
        a: Float[np.ndarray, "robot action"],
        hidden: Float[np.ndarray, "robot hidden"],
    ) -> tuple[Float32[np.ndarray, "robot state"], Float[np.ndarray, "robot hidden_after"]]:
        """State channels and hidden variables one control step later."""
        ...


class Differences(NamedTuple):
    """Steps from known or estimated hidden variables, and how far off S is after them.

    Attributes:
        inputs: what the network reads, (step, input).
        target: differences in units of their spread, (step, hidden); zero where nothing is told.
        rows: of the transitions that the steps are, (step,).
    """

    inputs: Float[Tensor, "step input"]
    target: Float[Tensor, "step hidden"]
    rows: Int[np.ndarray, " step"]


def fit_hidden_shift(
    model: WorldModel,
    shift: HiddenShift,
    estimator: HiddenEstimator,
    simulator: Advancing,
    real: Transitions,
    held: Transitions,
    budget: Regression,
    progress: Progress | None = None,
) -> None:
    """Learn the difference on R's transitions, and choose its shares on others.

    Args:
        model: translates, with a fitted mean field.
        shift: is fitted in place.
        estimator: of what was hidden, fitted.
        simulator: S.
        real: transitions of R, ordered by episode and step; their hidden variables are not read.
        held: likewise, of which nothing is learned.
        budget: of the regression.
        progress: called with (done, total) steps.
    """
    hidden = estimator.estimate(real) if estimator.told.any() else None
    known = hidden is not None and differences(
        model.frame, shift, simulator, real, hidden, estimator.told
    )
    if known:
        shift.requires_grad_(True)
        learn(shift.net, known, budget, progress)
        shift.requires_grad_(False)
        choose_gain(model, shift, estimator, simulator, held)


def differences(
    frame: Frame,
    shift: HiddenShift,
    simulator: Advancing,
    data: Transitions,
    hidden: Float[np.ndarray, "row hidden"],
    told: Bool[np.ndarray, " hidden"],
) -> Differences | None:
    """What is to be learned; None where no two transitions follow each other.

    Args:
        frame: with fitted normalisers.
        shift: its scales are set.
        simulator: S, which takes the steps.
        data: transitions, ordered by episode and step.
        hidden: their hidden variables, as known or as estimated.
        told: those that are to be learned of.
    """
    rows = _followed(data, 1)
    answer, after = simulator.advance("sim", data.o[rows], data.a[rows], hidden[rows])
    difference = hidden[rows + 1] - after
    whole = np.isfinite(difference).all(axis=1) & np.isfinite(answer).all(axis=1)
    rows, answer, difference = rows[whole], answer[whole], difference[whole]
    if not len(rows):
        return None
    for name, values in {
        "center": hidden.mean(axis=0),
        "spread": np.where(told, hidden.std(axis=0), 1.0),
        "unit": np.where(told, difference.std(axis=0), 0.0),
    }.items():
        getattr(shift, name).copy_(torch.tensor(values, dtype=torch.float32))
    o, a = torch.tensor(data.o[rows]), torch.tensor(data.a[rows])
    with torch.no_grad():
        changes = frame.changes(o, torch.tensor(answer))
        inputs = shift.inputs(frame.conditions(o, a), changes, torch.tensor(hidden[rows]))
    target = torch.tensor(difference, dtype=torch.float32) / shift.unit.clamp_min(1e-9)
    return Differences(inputs, target * (shift.unit > 0), rows)


def learn(
    net: nn.Module, known: Differences, budget: Regression, progress: Progress | None
) -> None:
    """Regress differences on what the network reads."""
    told = known.target.abs().amax(dim=0) > 0

    def error(index: Tensor) -> Tensor:
        out: Tensor = (net(known.inputs[index]) - known.target[index]) * told
        return out

    budget = replace(budget, seed=member_seed(budget.seed, 3))
    regress(net, error, len(known.target), budget, progress=progress)


@torch.no_grad()
def choose_gain(
    model: WorldModel,
    shift: HiddenShift,
    estimator: HiddenEstimator,
    simulator: Advancing,
    held: Transitions,
) -> None:
    """Set the shares of the difference that keep rollouts nearest to a recording of R."""
    starts, hidden = _followed(held, HORIZON), estimator.estimate(held)
    if not len(starts) or hidden is None:
        return
    spread = np.linspace(0, len(starts) - 1, min(STARTS, len(starts))).round().astype(int)
    best = np.inf

    def tried(gain: Tensor) -> None:
        nonlocal best
        before = shift.gain.clone()
        shift.gain.copy_(gain)
        error = _error(model, simulator, held, starts[spread], hidden)
        if error < best:
            best = error
        else:
            shift.gain.copy_(before)

    for share in GAINS:
        tried(torch.full_like(shift.gain, share))
    for variable in np.flatnonzero(estimator.told):
        for share in OF_ONE:
            other = shift.gain.clone()
            other[variable] = share
            if not torch.equal(other, shift.gain):
                tried(other)


def _error(
    model: WorldModel,
    simulator: Advancing,
    held: Transitions,
    starts: Int[np.ndarray, " robot"],
    estimates: Float[np.ndarray, "row hidden"],
) -> float:
    """Mean squared error of the normalised state along rollouts; infinite where one explodes."""
    n, scale = model.spec.n_state, model.frame.state.std.cpu().numpy()
    o, hidden, total = held.o[starts], estimates[starts], 0.0
    for k in range(HORIZON):
        a = held.a[starts + k]
        answer, after = simulator.advance("sim", o, a, hidden)
        state = translated(model, o, a, answer)
        hidden = carried(model, o, a, answer, hidden, after)
        off = (state - held.s_next[starts + k]) / scale
        total += float(np.minimum(off**2, 1e3).mean()) if np.isfinite(off).all() else np.inf
        if k + 1 < HORIZON:
            o = np.hstack([state, held.o[starts + k + 1][:, n:]])
    return total / HORIZON


def _followed(data: Transitions, steps: int) -> Int[np.ndarray, " row"]:
    """Rows after which so many more of the same episode come, one after the other."""
    row = np.arange(len(data) - steps)
    same = data.episode[row + steps] == data.episode[row]
    return row[same & (data.step[row + steps] == data.step[row] + steps)]
