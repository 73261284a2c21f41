"""Likelihood of a hypothesis: errors of its replays, and what may adapt beside it.

The error of a replay is judged once the initial state of its stretches and the model's tolerances
have adapted (:mod:`wt.diagnose.likelihood.adapt`). Both are linear around a reference hypothesis,
so that a new hypothesis costs one replay and no more; replays are run with the tolerances as they
were estimated, so that the linear part stays small. Replays take coarse steps
(:mod:`wt.diagnose.likelihood.replays`).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.diagnose.likelihood.adapt import (
    REWEIGHTED,
    Adaptable,
    Squares,
    initial_deviations,
    initial_states,
    linear,
)
from wt.diagnose.likelihood.replays import Extrapolated, Nearby
from wt.diagnose.likelihood.tolerances import Nuisance, boxes, nuisances
from wt.diagnose.likelihood.weights import Channels
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis
from wt.physics.replay import Stretch

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Assessed:
    """A hypothesis against the recordings.

    Attributes:
        hypothesis: what was replayed.
        loglik: log-likelihood, up to a constant [nats]; −inf if a replay exploded.
        variance: mean square error after the adaptations, (parts, nv): of all samples where
            replays are smooth, of each stretch where feet land.
        nuisance: the adapted errors, in standard deviations.
        centre: those that it was replayed with.
        error: projected error that replays without any nuisance would have, (N, nv).
    """

    hypothesis: Hypothesis
    loglik: float
    variance: Array
    nuisance: Array
    centre: Array
    error: Array

    @property
    def mse(self) -> Array:
        """Mean square error that is typical of each joint, (nv,): geometric over the parts."""
        return np.asarray(np.exp(np.log(self.variance).mean(axis=0)))


_RELINEARISED, _LINEAR = 4, 0.3
"""Most linearisations around a hypothesis; error of the linear part that is let be, in noise."""
_ALIKE = 4  # replays that tell how rough they are
_WORTHWHILE = 0.05  # deviations: a smaller correction is not worth a change of the model
BURN_IN_S = 0.25
"""Start of a long stretch that is not scored: hidden states (gears, buffers) settle [s]."""


class Objective:
    """Replays on a choice of stretches, and their likelihood.

    Attributes:
        motion, scene: the recordings, smoothed, and their machine.
        channels: how much each sample counts. The smallest error of a joint is noise, and what
            laws are apart from machines (``thresholds.law_error``).
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
            step: fine physics step [s].
            forgets: whether the machine forgets its initial state, so that stretches are long.
        """
        self.motion, self.scene = smoothed.motion, smoothed.motion.scene
        self.noise = np.nan_to_num(smoothed.noise, nan=1.0)
        self.stretches = tuple(s for s, _ in stretches)
        self.measured = np.concatenate([q for _, q in stretches])
        self.t = np.concatenate([s.t for s in self.stretches])
        self.recording = np.concatenate([np.full(len(s.t), s.recording) for s in self.stretches])
        burn = BURN_IN_S if forgets else 0.0
        settled = np.concatenate([s.t >= s.t[0] + burn for s in self.stretches])
        valid = np.isfinite(self.measured) & settled[:, None]
        self.forgets = forgets
        ends = np.cumsum([len(s.t) for s in self.stretches])
        self._rows = tuple(
            slice(int(end) - len(s.t), int(end))
            for end, s in zip(ends, self.stretches, strict=True)
        )
        self._replays = Extrapolated(self.scene, self.stretches, step)
        seconds = sum(s.t[-1] - s.t[0] for s in self.stretches)
        count = np.minimum(
            seconds * THRESHOLDS.independent_hz * valid.mean(axis=0), valid.sum(axis=0)
        )
        parts = self._rows if self.scene.free else (slice(None),)
        self.channels = Channels(valid, parts, count, np.tile(self.noise, (len(parts), 1)))
        self.some: tuple[Nuisance, ...] = nuisances(self.scene)
        uncertain = np.zeros(0) if forgets else initial_deviations(self.noise, noise_v0)
        floating = bool(self.scene.free)
        self._nearby = Nearby(self._replays, self.some, uncertain, once=floating)
        self._relinearised = 1 if floating else _RELINEARISED
        self._able = self._nearby.able
        none = np.zeros((*self.measured.T.shape, len(self.some)))
        self._around = Adaptable(none, np.zeros(len(self.some)), parts)
        self._reference: Assessed | None = None
        law = THRESHOLDS.law_error * np.nan_to_num(self.channels.rms(self._raw([()])[0]))
        self.channels = replace(self.channels, floors=np.hypot(self.channels.floors, law))
        self._measured_rough = not floating  # how rough replays are is measured at first use

    @property
    def count(self) -> Array:
        """Independent samples per joint, (nv,)."""
        return self.channels.count

    @property
    def floor(self) -> Array:
        """Error of a replay that leaves nothing to explain, (nv,)."""
        return self.channels.floor

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
        centres = [
            np.where(self._able & (boxes(self.some, h) > 0.0), c, 0.0)
            for h, c in zip(hypotheses, centres, strict=True)
        ]
        raw = self._raw(
            [(*h, *self._nearby.rig(c)) for h, c in zip(hypotheses, centres, strict=True)]
        )
        return [
            self._assess(h, self._around.at_origin(e, c), c)
            for h, c, e in zip(hypotheses, centres, raw, strict=True)
        ]

    def _raw(self, hypotheses: Sequence[Hypothesis]) -> Array:
        """Simulated minus measured positions, (H, N, nv)."""
        return self._errors(self._replays.run(hypotheses))

    def _errors(self, q: Array) -> Array:
        return np.where(self.channels.valid, q - self.measured, 0.0)

    def reference(self, hypothesis: Hypothesis, nuisance: Array | None = None) -> Assessed:
        """Linearise what may adapt around a hypothesis, and assess it.

        Again around what was found, until replays with it say the same as the linear prediction;
        not at all where it is the reference already.

        Args:
            hypothesis: the reference.
            nuisance: where the rig's errors are believed, in deviations; as before if left out.
        """
        last = self._reference
        if nuisance is None and last and hypothesis == last.hypothesis:
            return last
        if nuisance is not None:
            self._around = replace(self._around, centre=np.where(self._able, nuisance, 0.0))
        for _ in range(self._relinearised):
            assessed = self._linearised(hypothesis)
            centre = np.where(self._able, assessed.nuisance, 0.0)
            (actual,) = self._raw([(*hypothesis, *self._nearby.rig(centre))])
            apart = self._around.project(actual) - assessed.error - self._around.moved(centre)
            if not (self.channels.rms(apart) > _LINEAR * self.noise).any():
                break
            self._around = replace(self._around, centre=centre)
        self._reference = assessed
        return assessed

    def _linearised(self, hypothesis: Hypothesis) -> Assessed:
        """Linearise around a hypothesis and the present nuisances."""
        centre = self._around.centre
        q, changes, response = self._nearby.around(hypothesis, centre)
        error, columns = self._errors(q), np.where(self.channels.valid, changes, 0.0)
        parts = self.channels.parts
        if self.forgets:
            self._around = linear(columns, centre, parts)
            return self._assess(hypothesis, self._around.at_origin(error, centre), centre)
        response = response * self.channels.valid[:, :, None]
        known = np.nan_to_num(error, nan=1.0) ** 2
        variance = self.channels.variance(self.channels.sums(known))
        # how far an initial state may go depends on what is left once all has adapted
        for _ in range(REWEIGHTED):
            initial = initial_states(self._rows, response, variance)
            self._around = linear(columns, centre, parts, initial)
            assessed = self._assess(hypothesis, self._around.at_origin(error, centre), centre)
            variance = np.where(np.isfinite(assessed.variance), assessed.variance, variance)
        if not self._measured_rough:
            self._measured_rough = True
            self.channels = self.channels.rougher(self._apart(hypothesis, error))
            return self._linearised(hypothesis)
        return assessed

    def _apart(self, hypothesis: Hypothesis, error: Array) -> list[Array]:
        """What replays with errors of the rig differ by from their linear prediction, (N, nv) each.

        Args:
            hypothesis: the reference.
            error: of its replay, (N, nv).
        """
        rng, found = np.random.default_rng(0), []
        for size in rng.normal(size=(_ALIKE, len(self.some))) * self._able:
            (other,) = self._raw([(*hypothesis, *self._nearby.rig(self._around.centre + size))])
            apart = self._around.project(np.nan_to_num(other - error))
            found.append(apart - self._around.moved(size))
        return found

    def _assess(self, hypothesis: Hypothesis, error: Array, centre: Array) -> Assessed:
        """Likelihood of a projected error, with the nuisances adapted inside their box."""
        if not np.isfinite(error).all():
            bad = np.full(self.channels.floors.shape, np.inf)
            return Assessed(hypothesis, -np.inf, bad, np.zeros(len(self.some)), centre, error)
        squares, nuisance = self._around.squares(error), np.zeros(len(self.some))
        variance = self.channels.variance(squares.total)
        for _ in range(3):
            nuisance = self._adapt(squares, variance, boxes(self.some, hypothesis))
            variance = self.channels.variance(squares.left(nuisance))
        loglik = self.channels.nats(variance) - 0.5 * float(nuisance @ nuisance)
        return Assessed(hypothesis, loglik, variance, nuisance, centre, error)

    def left(self, assessed: Assessed) -> Array:
        """The error once the nuisances have adapted, (N, nv)."""
        return self.adapted(assessed.error, assessed.nuisance)

    def adapted(self, error: Array, nuisance: Array) -> Array:
        """A projected error (N, nv) with so many deviations of each nuisance."""
        return np.asarray(error + self._around.moved(nuisance))

    def only(self, rows: Array) -> Objective:
        """The same replays, judged by some of the samples, (N,) bool."""
        some = copy.copy(self)
        some._replays, some._reference = copy.copy(self._replays), None
        some._nearby = self._nearby.on(some._replays)
        some.channels = self.channels.only(rows)
        return some

    def calibration(self, assessed: Assessed) -> Hypothesis:
        """The nuisances as small corrections of the model, without those that it cannot hold."""
        able = np.flatnonzero(self._able)
        squares, size = self._around.squares(assessed.error), boxes(self.some, assessed.hypothesis)
        sizes = self._adapt(squares.only(able), assessed.variance, size[able])
        found = [(self.some[i], float(x)) for i, x in zip(able, sizes, strict=True)]
        return tuple(n.scaled(x) for n, x in found if abs(x) > _WORTHWHILE)

    def _adapt(self, squares: Squares, variance: Array, size: Array) -> Array:
        """Nuisances inside their boxes."""
        return squares.step(self.channels.weights(variance), -size, size, np.ones(len(size)))

    def solve(
        self,
        now: Assessed,
        jacobian: Array,
        lower: Array,
        upper: Array,
        damping: float,
        prior_std: Array | float = np.inf,
    ) -> tuple[Array, Array]:
        """One bounded Gauss-Newton step of parameters and nuisances together.

        Args:
            now: where the step is taken from.
            jacobian: of the error in the parameters, (N, nv, p).
            lower: smallest step, (p,).
            upper: largest step, (p,).
            damping: Levenberg-Marquardt, relative to the diagonal.
            prior_std: spread of a prior on each step, (p,).

        Returns:
            (nuisances, step of the parameters).
        """
        squares = self._around.squares_beside(now.error, jacobian)
        p, size = jacobian.shape[2], boxes(self.some, now.hypothesis)
        low, high = np.concatenate([lower, -size]), np.concatenate([upper, size])
        prior = np.concatenate([np.full(p, 1.0) / np.square(prior_std), np.ones(len(size))])
        damped = np.concatenate([np.full(p, damping), np.zeros(len(size))])
        x = squares.step(self.channels.weights(now.variance), low, high, prior, damped)
        return x[p:], x[:p]

    @property
    def nudge(self) -> float:
        """How much larger finite differences are than where replays are smooth."""
        return self._nearby.nudge

    @property
    def columns(self) -> Array:
        """Change of the error per deviation of each nuisance, (N, nv, n)."""
        return self._around.columns

    @property
    def numerical_error(self) -> Array:
        """Half of the steps' known error, projected, (N, nv): what may still be wrong."""
        known = np.where(self.channels.valid, self._replays.correction, 0.0)
        return 0.5 * self._around.project(known)
