"""How well a hypothesis replays the recordings: errors, likelihood, and what may adapt beside it.

The error of a replay is projected in two ways before it is judged. The estimated initial state of
each stretch is uncertain, so what a plausible other initial state explains is taken out; and what
any rig is off by (:mod:`wt.diagnose.nuisance`) may adapt inside its box. Both are linear around a
reference hypothesis, so that a new hypothesis costs one replay and no more. Replays take coarse
steps; what fine steps change is added from the reference, where it is computed exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from wt.diagnose.nuisance import BOX, Nuisance, nuisances
from wt.diagnose.smooth import Smoothed
from wt.physics.replay import Planted, Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene

Array = np.ndarray

Hypothesis = tuple[Planted, ...]

INDEPENDENT_PER_SECOND = 10.0
"""Errors of replays remember; this many samples a second count as new."""
COARSE = 2.0
"""Physics step of most replays, in steps of the final ones; the extrapolation needs two."""
_WORTHWHILE = 0.05  # deviations: a smaller correction is not worth a change of the model
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
        error: projected error, before the nuisances' share is taken out, (N, nv).
    """

    hypothesis: Hypothesis
    loglik: float
    mse: Array
    nuisance: Array
    error: Array


class Objective:
    """Replays on a choice of stretches, and their likelihood.

    Attributes:
        count: independent samples per joint, (nv,).
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
        self._sigma0 = np.concatenate([0.5 * self.noise, noise_v0])
        self._fine = Replayer(self.scene, self.stretches, step)
        self._coarse = Replayer(self.scene, self.stretches, COARSE * step)
        self._correction = np.zeros_like(self.measured)
        seconds = sum(s.t[-1] - s.t[0] for s in self.stretches)
        share = self.valid.mean(axis=0)
        self.count = np.minimum(seconds * INDEPENDENT_PER_SECOND * share, self.valid.sum(axis=0))
        self.some: tuple[Nuisance, ...] = nuisances(self.scene)
        self._jacobian = np.zeros((*self.measured.shape, 0))
        self._initial: list[tuple[Array, Array]] = []

    def rows(self, stretch: int) -> slice:
        """Rows of one stretch among all samples."""
        end = int(self._ends[stretch])
        return slice(end - len(self.stretches[stretch].t), end)

    def raw(self, hypotheses: Sequence[Hypothesis]) -> Array:
        """Simulated minus measured positions, (H, N, nv); 0 where nothing counts."""
        q = self._coarse.run(hypotheses).q + self._correction
        return np.where(self.valid, q - self.measured, 0.0)

    def reference(self, hypothesis: Hypothesis) -> Assessed:
        """Linearise what may adapt around a hypothesis, and assess it."""
        nv = self.scene.model.nv
        shifted = [hypothesis, *((*hypothesis, n.planted) for n in self.some)]
        self._correction = np.zeros_like(self.measured)
        errors = self.raw(shifted)
        # the steps' error is of first order: Richardson's extrapolation removes it
        exact = 2.0 * self._fine.run([hypothesis]).q[0] - self.measured
        exact -= errors[0] + self.measured
        self._correction = np.nan_to_num(np.where(self.valid, exact - errors[0], 0.0))
        errors = errors + self._correction
        self.mse = self._mse(np.nan_to_num(errors[0], nan=1.0))
        self._initial = []
        if not self.forgets:
            self._initial = self._initial_response(hypothesis, errors[0], nv)
        base = self.project(errors[0])
        self._jacobian = np.stack(
            [np.nan_to_num(self.project(e) - base) for e in errors[1:]], axis=2
        )
        assessed = self.assess(hypothesis, base)
        self.mse = assessed.mse
        return assessed

    def _initial_response(
        self, hypothesis: Hypothesis, base: Array, nv: int
    ) -> list[tuple[Array, Array]]:
        """Per stretch: response to the initial state (K·nv, 2nv), and its ridge solution."""
        moved = []
        for k in range(2 * nv):
            shift = np.zeros(2 * nv)
            shift[k] = self._sigma0[k]
            stretches = [
                Stretch(s.recording, s.t, s.held, s.q0 + shift[:nv], s.v0 + shift[nv:])
                for s in self.stretches
            ]
            q = Replayer(self.scene, stretches, self._coarse.step).run([hypothesis]).q[0]
            shifted = q + self._correction - self.measured
            moved.append(np.where(self.valid, shifted, 0.0) - base)
        response = np.nan_to_num(np.stack(moved, axis=2))
        found = []
        for i in range(len(self.stretches)):
            s = response[self.rows(i)]
            weighted = s / self.mse[:, None]
            flat, w = s.reshape(-1, 2 * nv), weighted.reshape(-1, 2 * nv)
            solve = np.linalg.solve(w.T @ flat + np.eye(2 * nv), w.T)
            found.append((flat, solve))
        return found

    def project(self, error: Array) -> Array:
        """Take out of an error (N, nv) what a plausible other initial state explains."""
        if not self._initial:
            return error
        left = error.copy()
        for i, (flat, solve) in enumerate(self._initial):
            part = error[self.rows(i)].reshape(-1)
            left[self.rows(i)] -= (flat @ (solve @ part)).reshape(-1, error.shape[1])
        return left

    def assess(self, hypothesis: Hypothesis, error: Array) -> Assessed:
        """Likelihood of a projected error, with the nuisances adapted inside their box."""
        if not np.isfinite(error).all():
            bad = np.full(error.shape[1], np.inf)
            return Assessed(hypothesis, -np.inf, bad, np.zeros(len(self.some)), error)
        nuisance = np.zeros(self._jacobian.shape[2])
        mse = self._mse(error)
        for _ in range(3):
            nuisance = self._adapt(error, self._jacobian, mse)
            mse = self._mse(error + self._jacobian @ nuisance)
        loglik = -0.5 * float(self.count @ np.log(mse)) - 0.5 * float(nuisance @ nuisance)
        return Assessed(hypothesis, loglik, mse, nuisance, error)

    def left(self, assessed: Assessed) -> Array:
        """The error once the nuisances have adapted, (N, nv)."""
        return np.asarray(assessed.error + self._jacobian @ assessed.nuisance)

    def calibration(self, assessed: Assessed) -> Hypothesis:
        """The nuisances as small corrections of the model, without those that it cannot hold."""
        able = [i for i, n in enumerate(self.some) if n.correctable]
        sizes = self._adapt(assessed.error, self._jacobian[:, :, able], assessed.mse)
        found = [(self.some[i], float(x)) for i, x in zip(able, sizes, strict=True)]
        return tuple(n.scaled(x) for n, x in found if abs(x) > _WORTHWHILE)

    def _adapt(self, error: Array, columns: Array, mse: Array) -> Array:
        """Nuisances inside their box, given their columns of the Jacobian: bounded ridge."""
        size = np.full(columns.shape[2], BOX)
        return self._step(error, columns, mse, -size, size, np.ones(len(size)))

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
        both = np.concatenate([jacobian, self._jacobian], axis=2)
        p, size = jacobian.shape[2], np.full(len(self.some), BOX)
        low, high = np.concatenate([lower, -size]), np.concatenate([upper, size])
        prior = np.concatenate([np.zeros(p), np.ones(len(size))])
        x = self._step(error, both, mse, low, high, prior, damping)
        return x[p:], x[:p]

    def _step(
        self,
        error: Array,
        columns: Array,
        mse: Array,
        low: Array,
        high: Array,
        prior: Array,
        damping: float = 0.0,
    ) -> Array:
        """Bounded least squares with a prior's weight for each column, damped where it is 0."""
        n = columns.shape[2]
        if n == 0:
            return np.zeros(0)
        # weights such that one joint's samples together count as its independent ones
        weight = self.count / np.maximum(self.valid.sum(axis=0), 1) / mse
        flat = columns.reshape(-1, n)
        weighted = (columns * weight[:, None]).reshape(-1, n)
        gram = flat.T @ weighted
        gram[range(n), range(n)] *= np.where(prior > 0.0, 1.0, 1.0 + damping)
        gram[range(n), range(n)] += prior
        right = -weighted.T @ error.reshape(-1)
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        scaled = gram / scale / scale[:, None] + 1e-9 * np.eye(n)
        root = np.linalg.cholesky(scaled)
        bounds = (low * scale - 1e-12, high * scale + 1e-12)
        found = lsq_linear(root.T, np.linalg.solve(root, right / scale), bounds)
        return np.asarray(found.x) / scale

    def curvature(self, now: Assessed, slope: Array, block_s: float) -> tuple[Array, Array, int]:
        """What intervals are made of.

        Args:
            now: the fitted hypothesis.
            slope: Jacobian of its error in the parameters, (N, nv, p).
            block_s: length of the blocks that count as independent [s].

        Returns:
            (Hessian of parameters and nuisances, the nuisances' prior included; score of each
            block; number of blocks).
        """
        both = np.concatenate([slope, self._jacobian], axis=2)
        p, n = slope.shape[2], both.shape[2]
        weighted = both / now.mse[:, None]
        hessian = weighted.reshape(-1, n).T @ both.reshape(-1, n)
        hessian[range(p, n), range(p, n)] += 1.0
        left = self.left(now)
        labels = np.stack([self.recording, (self.t / block_s).astype(int)], axis=1)
        _, block = np.unique(labels, axis=0, return_inverse=True)
        count = int(block.max()) + 1
        scores = np.zeros((count, n))
        np.add.at(scores, block.ravel(), np.einsum("ijk,ij->ik", weighted, left))
        return hessian, scores, count

    def numerical_score(self, now: Assessed, slope: Array) -> Array:
        """Score that half of the steps' known error would have, (p + nuisances,).

        Args:
            now: the fitted hypothesis.
            slope: Jacobian of its error in the parameters, (N, nv, p).
        """
        both = np.concatenate([slope, self._jacobian], axis=2) / now.mse[:, None]
        wrong = 0.5 * self.project(self._correction)
        return np.asarray(np.einsum("ijk,ij->k", both, wrong))

    def _mse(self, error: Array) -> Array:
        count = np.maximum(self.valid.sum(axis=0), 1)
        return np.maximum((error**2).sum(axis=0) / count, self.noise**2)
