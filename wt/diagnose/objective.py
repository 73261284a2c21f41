"""How well a hypothesis replays the recordings: errors, likelihood, and what may adapt beside it.

The error of a replay is judged once the initial state of its stretches and what any rig is off by
have adapted (:mod:`wt.diagnose.adapt`). Both are linear around a reference hypothesis, so that a
new hypothesis costs one replay and no more; replays are run with what the rig was found to be off
by, so that the linear part stays small. Replays take coarse steps; what fine steps change is added
from the reference, where it is computed exactly.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose.adapt import (
    REWEIGHTED,
    Adaptable,
    bounded_step,
    box,
    initial_deviations,
    initial_states,
    linear,
    responses,
)
from wt.diagnose.nuisance import Nuisance, nuisances
from wt.diagnose.smooth import Smoothed
from wt.physics.replay import Planted, Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene

Array = np.ndarray

Hypothesis = tuple[Planted, ...]


def without(hypothesis: Hypothesis, index: int) -> Hypothesis:
    """All effects but one."""
    return hypothesis[:index] + hypothesis[index + 1 :]


INDEPENDENT_PER_SECOND = 10.0
"""Errors of replays remember; this many samples a second count as new."""
COARSE = 2.0
"""Physics step of most replays, in steps of the final ones; the extrapolation needs two."""
_STEP = 0.1  # deviations: long valleys between an effect and its nuisance need good derivatives
_RELINEARISED, _LINEAR = 4, 0.3
"""Most linearisations around a hypothesis; error of the linear part that is let be, in noise."""
_WORTHWHILE = 0.05  # deviations: a smaller correction is not worth a change of the model
LAW = 0.005
"""Share of what the model as given errs by that is left even by the right law: real friction,
say, is not quite the law's, and an error this small is no sign of anything else."""
BURN_IN_S = 0.25
"""Start of a long stretch that is not scored: hidden states (gears, buffers) settle [s]."""


@dataclass(frozen=True, eq=False)
class Assessed:
    """A hypothesis against the recordings.

    Attributes:
        hypothesis: what was replayed.
        loglik: log-likelihood, up to a constant [nats]; −inf if a replay exploded.
        mse: mean square error per joint after the adaptations, (nv,).
        nuisance: the adapted errors, in standard deviations.
        centre: those that it was replayed with.
        error: projected error that replays without any nuisance would have, (N, nv).
    """

    hypothesis: Hypothesis
    loglik: float
    mse: Array
    nuisance: Array
    centre: Array
    error: Array


class Objective:
    """Replays on a choice of stretches, and their likelihood.

    Attributes:
        count: independent samples per joint, (nv,).
        floor: error of a replay that leaves nothing to explain: noise, and what laws are apart
            from machines (:data:`LAW`), (nv,).
    """

    def __init__(
        self,
        smoothed: Smoothed,
        stretches: Sequence[tuple[Stretch, Array]],
        noise_v0: Array,
        step: float,
        forgets: bool,
    ) -> None:
        """Prepare.

        Args:
            smoothed: gives scene and noise.
            stretches: what to replay, each with the measured positions (K, nv).
            noise_v0: uncertainty of an initial velocity, (nv,).
            step: physics step [s].
            forgets: whether the machine forgets its initial state, so that stretches are long.
        """
        self.scene: Scene = smoothed.motion.scene
        self.noise = np.nan_to_num(smoothed.noise, nan=1.0)
        self.stretches = tuple(s for s, _ in stretches)
        self.measured = np.concatenate([q for _, q in stretches])
        self.t = np.concatenate([s.t for s in self.stretches])
        self.recording = np.concatenate([np.full(len(s.t), s.recording) for s in self.stretches])
        burn = BURN_IN_S if forgets else 0.0
        settled = np.concatenate([s.t >= s.t[0] + burn for s in self.stretches])
        self.valid = np.isfinite(self.measured) & settled[:, None]
        self.forgets = forgets
        self._ends = np.cumsum([len(s.t) for s in self.stretches])
        self._sigma0 = initial_deviations(self.noise, noise_v0)
        self._fine = Replayer(self.scene, self.stretches, step)
        self._coarse = Replayer(self.scene, self.stretches, COARSE * step)
        self._correction = np.zeros_like(self.measured)
        seconds = sum(s.t[-1] - s.t[0] for s in self.stretches)
        share = self.valid.mean(axis=0)
        self.count = np.minimum(seconds * INDEPENDENT_PER_SECOND * share, self.valid.sum(axis=0))
        self.some: tuple[Nuisance, ...] = nuisances(self.scene)
        self._able = np.array([n.correctable for n in self.some], dtype=bool)
        none = np.zeros((*self.measured.shape, len(self.some)))
        self._around = Adaptable(none, np.zeros(len(self.some)))
        given = np.nan_to_num(self._rms(self._raw([()])[0]))
        self.floor = np.hypot(self.noise, LAW * given)

    def rows(self, stretch: int) -> slice:
        """Rows of one stretch among all samples."""
        end = int(self._ends[stretch])
        return slice(end - len(self.stretches[stretch].t), end)

    def evaluate(
        self, hypotheses: Sequence[Hypothesis], centres: Sequence[Array] | None = None
    ) -> list[Assessed]:
        """Replay and assess hypotheses, each with nuisances close to those that it will have.

        Args:
            hypotheses: what to replay.
            centres: nuisances of each, in deviations; those of the reference if left out.
        """
        if centres is None:
            centres = [self._around.centre] * len(hypotheses)
        centres = [np.where(self._able, c, 0.0) for c in centres]
        raw = self._raw([(*h, *self._rig(c)) for h, c in zip(hypotheses, centres, strict=True)])
        return [
            self._assess(h, self._around.at_origin(e, c), c)
            for h, c, e in zip(hypotheses, centres, raw, strict=True)
        ]

    def _raw(self, hypotheses: Sequence[Hypothesis]) -> Array:
        """Simulated minus measured positions, (H, N, nv)."""
        q = self._coarse.run(hypotheses).q + self._correction
        return np.where(self.valid, q - self.measured, 0.0)

    def _rig(self, sizes: Array) -> Hypothesis:
        """Nuisances of so many deviations, those that a model can hold."""
        pairs = zip(self.some, sizes, strict=True)
        return tuple(n.scaled(float(x)) for n, x in pairs if n.correctable and x)

    def reference(self, hypothesis: Hypothesis, nuisance: Array | None = None) -> Assessed:
        """Linearise what may adapt around a hypothesis, and assess it.

        Again around what was found, until replays with it say the same as the linear prediction.

        Args:
            hypothesis: the reference.
            nuisance: where the rig's errors are believed, in deviations; as before if left out.
        """
        if nuisance is not None:
            self._around = replace(self._around, centre=np.where(self._able, nuisance, 0.0))
        for _ in range(_RELINEARISED):
            assessed = self._linearised(hypothesis)
            centre = np.where(self._able, assessed.nuisance, 0.0)
            (actual,) = self._raw([(*hypothesis, *self._rig(centre))])
            apart = self._around.project(actual) - assessed.error - self._around.columns @ centre
            if not (self._rms(apart) > _LINEAR * self.noise).any():
                break
            self._around = replace(self._around, centre=centre)
        return assessed

    def _linearised(self, hypothesis: Hypothesis) -> Assessed:
        """Linearise around a hypothesis and the present nuisances."""
        centre = self._around.centre
        here = (*hypothesis, *self._rig(centre))
        moved = [
            (*hypothesis, *self._rig(centre + one)) if n.correctable else (*here, n.planted)
            for n, one in zip(self.some, _STEP * np.eye(len(self.some)), strict=True)
        ]
        self._correction = np.zeros_like(self.measured)
        errors = self._raw([here, *moved])
        # the steps' error is of first order: Richardson's extrapolation removes it
        exact = 2.0 * self._fine.run([here]).q[0] - self.measured
        exact -= errors[0] + self.measured
        self._correction = np.nan_to_num(np.where(self.valid, exact - errors[0], 0.0))
        errors = errors + self._correction
        size = np.where(self._able, _STEP, 1.0)
        columns = np.nan_to_num(errors[1:] - errors[0]) / size[:, None, None]
        if self.forgets:
            self._around = linear(columns, centre)
            return self._assess(hypothesis, self._around.at_origin(errors[0], centre), centre)
        response = responses(self._coarse, here, self._sigma0) * self.valid[:, :, None]
        rows = [self.rows(i) for i in range(len(self.stretches))]
        mse = self._mse(np.nan_to_num(errors[0], nan=1.0))
        # how far an initial state may go depends on what is left once all has adapted
        for _ in range(REWEIGHTED):
            self._around = linear(columns, centre, initial_states(rows, response, mse))
            assessed = self._assess(hypothesis, self._around.at_origin(errors[0], centre), centre)
            mse = np.where(np.isfinite(assessed.mse), assessed.mse, mse)
        return assessed

    def _assess(self, hypothesis: Hypothesis, error: Array, centre: Array) -> Assessed:
        """Likelihood of a projected error, with the nuisances adapted inside their box."""
        if not np.isfinite(error).all():
            bad = np.full(error.shape[1], np.inf)
            return Assessed(hypothesis, -np.inf, bad, np.zeros(len(self.some)), centre, error)
        columns = self._around.columns
        nuisance, mse = np.zeros(len(self.some)), self._mse(error)
        for _ in range(3):
            nuisance = self._adapt(error, columns, mse)
            mse = self._mse(error + columns @ nuisance)
        loglik = -0.5 * float(self.count @ np.log(mse)) - 0.5 * float(nuisance @ nuisance)
        return Assessed(hypothesis, loglik, mse, nuisance, centre, error)

    def left(self, assessed: Assessed) -> Array:
        """The error once the nuisances have adapted, (N, nv)."""
        return self.adapted(assessed.error, assessed.nuisance)

    def adapted(self, error: Array, nuisance: Array) -> Array:
        """A projected error (N, nv) with so many deviations of each nuisance."""
        return np.asarray(error + self._around.columns @ nuisance)

    def only(self, rows: Array) -> Objective:
        """The same replays, judged by some of the samples, (N,) bool."""
        some = copy.copy(self)
        some.valid = self.valid & rows[:, None]
        share = some.valid.sum(axis=0) / np.maximum(self.valid.sum(axis=0), 1)
        some.count = self.count * share
        return some

    def calibration(self, assessed: Assessed) -> Hypothesis:
        """The nuisances as small corrections of the model, without those that it cannot hold."""
        able = np.flatnonzero(self._able)
        sizes = self._adapt(assessed.error, self._around.columns[:, :, able], assessed.mse)
        found = [(self.some[i], float(x)) for i, x in zip(able, sizes, strict=True)]
        return tuple(n.scaled(x) for n, x in found if abs(x) > _WORTHWHILE)

    def _adapt(self, error: Array, columns: Array, mse: Array) -> Array:
        """Nuisances inside their box, given their columns."""
        size = box(columns.shape[2])
        prior = np.ones(len(size))
        return bounded_step(error, columns, self._weight(mse), -size, size, prior)

    def solve(
        self, error: Array, jacobian: Array, mse: Array, lower: Array, upper: Array, damping: float
    ) -> tuple[Array, Array]:
        """One bounded Gauss-Newton step of parameters and nuisances together.

        Args:
            error: (N, nv).
            jacobian: of the error in the parameters, (N, nv, p).
            mse: per joint, the weights' inverse.
            lower: smallest step, (p,).
            upper: largest step, (p,).
            damping: Levenberg-Marquardt, relative to the diagonal.

        Returns:
            (nuisances, step of the parameters).
        """
        both = np.concatenate([jacobian, self._around.columns], axis=2)
        p, size = jacobian.shape[2], box(len(self.some))
        low, high = np.concatenate([lower, -size]), np.concatenate([upper, size])
        prior = np.concatenate([np.zeros(p), np.ones(len(size))])
        x = bounded_step(error, both, self._weight(mse), low, high, prior, damping)
        return x[p:], x[:p]

    def _weight(self, mse: Array) -> Array:
        """Weights with which one joint's samples together count as its independent ones, (nv,)."""
        return np.asarray(self.count / np.maximum(self.valid.sum(axis=0), 1) / mse)

    @property
    def columns(self) -> Array:
        """Change of the error per deviation of each nuisance, (N, nv, n)."""
        return self._around.columns

    @property
    def numerical_error(self) -> Array:
        """Half of the steps' known error, projected, (N, nv): what may still be wrong."""
        return 0.5 * self._around.project(self._correction)

    def _mse(self, error: Array) -> Array:
        return np.maximum(self._rms(error) ** 2, self.floor**2)

    def _rms(self, error: Array) -> Array:
        count = np.maximum(self.valid.sum(axis=0), 1)
        return np.asarray(np.sqrt((error**2).sum(axis=0) / count))
