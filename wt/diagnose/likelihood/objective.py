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
from jaxtyping import Bool, Float

from wt.diagnose.likelihood.adapt import (
    FARTHEST,
    REWEIGHTED,
    Adaptable,
    Squares,
    initial_states,
    linear,
    project_changes,
)
from wt.diagnose.likelihood.replays import Nearby, Replays
from wt.diagnose.likelihood.steps import Steps
from wt.diagnose.likelihood.tolerances import ModelTolerance, alike, boxes, rounded, tolerances
from wt.diagnose.likelihood.weights import Channels
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.recordings.stretches import BURN_IN_S
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis
from wt.physics.replay import Stretch


@dataclass(frozen=True, eq=False)
class Assessed:
    """A hypothesis against the recordings.

    Attributes:
        hypothesis: what was replayed.
        loglik: log-likelihood, up to a constant [nats]; −inf if a replay exploded.
        variance: mean square error after the adaptations: of all samples where replays are
            smooth, of each stretch where feet land.
        tolerances: their adapted sizes [deviations].
        centre: those that it was replayed with.
        error: projected error that replays without any tolerance would have.
        raw: error of the replay itself; nothing has adapted.
    """

    hypothesis: Hypothesis
    loglik: float
    variance: Float[np.ndarray, "part dof"]
    tolerances: Float[np.ndarray, " tolerance"]
    centre: Float[np.ndarray, " tolerance"]
    error: Float[np.ndarray, "sample dof"]
    raw: Float[np.ndarray, "sample dof"]

    @property
    def mse(self) -> Float[np.ndarray, " dof"]:
        """Mean square error that is typical of each joint: geometric over the parts."""
        return np.asarray(np.exp(np.log(self.variance).mean(axis=0)))


_RELINEARISED, _LINEAR, _LEFT = 16, 0.3, 0.1
"""Most linearisations around a hypothesis; error of the linear part that is let be, in noise or in
this share of what is left, whichever is more. One or two do where drives hold a machine; where its
drives are torques, what a rig is off by moves it as far as what is looked for."""
_NO_BETTER = 1.0  # nats: a step that gains less is the last
_SHARES = (0.5, 0.25)
"""Of the way to where the linear part is at its best, that are tried where all of it is worse."""
_SHARP = 0.5  # noise: less than this is left by chance alone nowhere
_ALIKE = 4  # replays that tell how rough they are
_WORTHWHILE = 0.05  # deviations: a smaller correction is not worth a change of the model


class Objective:
    """Replays on a choice of stretches, and their likelihood.

    Attributes:
        motion, scene: the recordings, smoothed, and their machine.
        channels: how much each sample counts. The smallest error of a joint is noise, and what
            laws are apart from machines (``thresholds.law_error``).
        tolerances: of the model.
    """

    def __init__(
        self,
        smoothed: Smoothed,
        stretches: Sequence[tuple[Stretch, Float[np.ndarray, "_ dof"]]],
        step: float,
        forgets: bool,
        smooth: Steps | None = None,
    ) -> None:
        """Prepare.

        Args:
            smoothed: gives scene and noise.
            stretches: what to replay, each with the measured positions.
            step: fine physics step [s].
            forgets: whether the machine forgets its initial state, so that stretches are long.
            smooth: steps that do where no law is stiff, if they are longer.
        """
        self.motion, self.scene = smoothed.motion, smoothed.motion.scene
        self.noise = np.nan_to_num(smoothed.noise, nan=1.0)
        self.stretches = tuple(s for s, _ in stretches)
        self.measured = np.concatenate([q for _, q in stretches])
        self.t = np.concatenate([s.t for s in self.stretches])
        self.recording = np.concatenate([np.full(len(s.t), s.recording) for s in self.stretches])
        self.of_stretch = np.repeat(np.arange(len(stretches)), [len(q) for _, q in stretches])
        burn = BURN_IN_S if forgets else 0.0
        settled = np.concatenate([s.t >= s.t[0] + burn for s in self.stretches])
        valid = np.isfinite(self.measured) & settled[:, None]
        self.forgets = forgets
        ends = np.cumsum([len(s.t) for s in self.stretches])
        self._rows = tuple(
            slice(int(end) - len(s.t), int(end))
            for end, s in zip(ends, self.stretches, strict=True)
        )
        long = smooth.at_least(step) if smooth else Steps.usual(step)
        self._replays = Replays(self.scene, self.stretches, step, long)
        seconds = sum(s.t[-1] - s.t[0] for s in self.stretches)
        count = np.minimum(
            seconds * THRESHOLDS.independent_hz * valid.mean(axis=0), valid.sum(axis=0)
        )
        parts = self._rows if self.scene.free else (slice(None),)
        self.channels = Channels(valid, parts, count, np.tile(self.noise, (len(parts), 1)))
        self.tolerances: tuple[ModelTolerance, ...] = tolerances(self.scene)
        floating = bool(self.scene.free)
        self._nearby = Nearby(self._replays, self.tolerances, once=floating, remembers=not forgets)
        self._farthest = np.inf if floating else FARTHEST
        self._relinearised = 1 if floating else _RELINEARISED
        self._able = self._nearby.able
        none = np.zeros((*self.measured.T.shape, len(self.tolerances)))
        self._around = Adaptable(none, np.zeros(len(self.tolerances)), parts)
        self._reference: Assessed | None = None
        law = THRESHOLDS.law_error * np.nan_to_num(self.channels.rms(self._raw([()])[0]))
        self.channels = replace(self.channels, floors=np.hypot(self.channels.floors, law))
        self._measured_rough = not floating  # how rough replays are is measured at first use

    @property
    def count(self) -> Float[np.ndarray, " dof"]:
        """Independent samples per joint."""
        return self.channels.count

    @property
    def floor(self) -> Float[np.ndarray, " dof"]:
        """Error of a replay that leaves nothing to explain."""
        return self.channels.floor

    def evaluate(
        self,
        hypotheses: Sequence[Hypothesis],
        centres: Sequence[Float[np.ndarray, " tolerance"]] | None = None,
    ) -> list[Assessed]:
        """Replay and assess hypotheses, each with tolerances close to those that it will have.

        Args:
            hypotheses: what to replay.
            centres: tolerances of each [deviations]; those of the reference if left out.
        """
        if centres is None:
            centres = [self._around.centre] * len(hypotheses)
        return self._assessed(hypotheses, *self._with(hypotheses, centres))

    def _with(
        self, hypotheses: Sequence[Hypothesis], centres: Sequence[Float[np.ndarray, " tolerance"]]
    ) -> tuple[
        Float[np.ndarray, "hypothesis sample dof"], Float[np.ndarray, "hypothesis tolerance"]
    ]:
        """Errors of replays beside tolerances, and those that each hypothesis leaves of these."""
        able = [
            np.where(self._able & (boxes(self.tolerances, h) > 0.0), c, 0.0)
            for h, c in zip(hypotheses, centres, strict=True)
        ]
        raw = self._raw([(*h, *self._nearby.rig(c)) for h, c in zip(hypotheses, able, strict=True)])
        return raw, np.reshape(able, (len(raw), len(self._able)))

    def _raw(self, hypotheses: Sequence[Hypothesis]) -> Float[np.ndarray, "hypothesis sample dof"]:
        """Simulated minus measured positions."""
        return self._errors(self._replays.run(hypotheses))

    def _errors(
        self, q: Float[np.ndarray, "*hypothesis sample dof"]
    ) -> Float[np.ndarray, "*hypothesis sample dof"]:
        return np.where(self.channels.valid, q - self.measured, 0.0)

    def reference(
        self,
        hypothesis: Hypothesis,
        centre: Float[np.ndarray, " tolerance"] | None = None,
        most: int = _RELINEARISED,
        beside: Hypothesis | None = None,
    ) -> Assessed:
        """Linearise what may adapt around a hypothesis, and assess it.

        Again around what was found, until replays with it say the same as the linear prediction,
        or until no step that way is better; not at all where it is the reference already.

        Args:
            hypothesis: the reference.
            centre: where the tolerances are believed [deviations]; as before if left out.
            most: linearisations.
            beside: one whose tolerances may change replays alike, as with another law in a place;
                one linearisation more, where that will not do.
        """
        last = self._reference
        if centre is None and last and hypothesis == last.hypothesis:
            return last
        if centre is not None:
            self._around = replace(self._around, centre=np.where(self._able, centre, 0.0))
        lent = beside is not None and self._nearby.lent(hypothesis, beside)
        for turn in range(min(most, self._relinearised) + lent):
            assessed = self._linearised(hypothesis, anew=turn > 0)
            here, goal = assessed.centre, np.where(self._able, assessed.tolerances, 0.0)
            (actual,) = self._replayed(hypothesis, [goal])
            apart = actual - assessed.error - self._around.moved(goal)
            let_be = _LINEAR * np.maximum(self.noise, _LEFT * np.sqrt(assessed.mse))
            if not (self.channels.rms(apart) > let_be).any():
                break
            if lent and not turn:
                continue
            # the linear part promises too much: as far that way as replays do get better
            between = [here + share * (goal - here) for share in _SHARES]
            errors = [actual, *self._replayed(hypothesis, between)]
            errors.append(assessed.error + self._around.moved(here))
            ways = [goal, *between, here]
            found = [self._met(error, centre) for error, centre in zip(errors, ways, strict=True)]
            best = int(np.argmax(found))
            if found[best] - found[-1] < _NO_BETTER:
                break
            self._around = replace(self._around, centre=ways[best])
        self._reference = assessed
        return assessed

    def _replayed(
        self, hypothesis: Hypothesis, centres: Sequence[Float[np.ndarray, " tolerance"]]
    ) -> list[Float[np.ndarray, "sample dof"]]:
        """Projected errors of replays with tolerances of such sizes [deviations]."""
        raw = self._raw([(*hypothesis, *self._nearby.rig(centre)) for centre in centres])
        return [self._around.project(error) for error in raw]

    def _met(
        self, error: Float[np.ndarray, "sample dof"], centre: Float[np.ndarray, " tolerance"]
    ) -> float:
        """Likelihood of a projected error with the tolerances that it had, and no others."""
        if not np.isfinite(error).all():
            return -np.inf
        variance = self.channels.variance(self._around.squares(error[None])[0].total)
        return self.channels.nats(variance) - 0.5 * float(centre @ centre)

    def _linearised(self, hypothesis: Hypothesis, anew: bool = False) -> Assessed:
        """Linearise around a hypothesis and the present tolerances; see :meth:`Nearby.around`."""
        centre = self._around.centre
        q, changes, response = self._nearby.around(hypothesis, centre, anew)
        error, columns = self._errors(q), np.where(self.channels.valid, changes, 0.0)
        parts = self.channels.parts
        if self.forgets:
            self._around = linear(columns, centre, parts, error)
            return self._assessed([hypothesis], error[None], centre[None])[0]
        response = response * self.channels.valid[:, :, None]
        known = np.nan_to_num(error, nan=1.0) ** 2
        variance = self.channels.variance(self.channels.sums(known))
        # how far an initial state may go depends on what is left once all has adapted
        for _ in range(REWEIGHTED):
            initial = initial_states(self._rows, response, variance, self._farthest)
            self._around = linear(columns, centre, parts, error, initial)
            (assessed,) = self._assessed([hypothesis], error[None], centre[None])
            variance = np.where(np.isfinite(assessed.variance), assessed.variance, variance)
        if not self._measured_rough:
            self._measured_rough = True
            self.channels = self.channels.rougher(self._apart(hypothesis, error))
            return self._linearised(hypothesis)
        return assessed

    def _apart(
        self, hypothesis: Hypothesis, error: Float[np.ndarray, "sample dof"]
    ) -> list[Float[np.ndarray, "sample dof"]]:
        """Differences of replays with random tolerances from their linear prediction.

        Args:
            hypothesis: the reference.
            error: of its replay.
        """
        rng, differences = np.random.default_rng(0), []
        sizes = rng.normal(size=(_ALIKE, len(self.tolerances))) * self._able
        rigs = [self._nearby.rig(self._around.centre + size) for size in sizes]
        others = self._raw([(*hypothesis, *rig) for rig in rigs])
        for size, other in zip(sizes, others, strict=True):
            apart = self._around.project(np.nan_to_num(other - error))
            differences.append(apart - self._around.moved(size))
        return differences

    def _assessed(
        self,
        hypotheses: Sequence[Hypothesis],
        raw: Float[np.ndarray, "hypothesis sample dof"],
        centres: Float[np.ndarray, "hypothesis tolerance"],
    ) -> list[Assessed]:
        """Likelihoods of replays' errors, with the tolerances adapted inside their boxes."""
        each = zip(hypotheses, raw, centres, self._around.read(raw, centres), strict=True)
        return [self._assess(h, r, c, *read) for h, r, c, read in each]

    def _assess(
        self,
        hypothesis: Hypothesis,
        raw: Float[np.ndarray, "sample dof"],
        centre: Float[np.ndarray, " tolerance"],
        error: Float[np.ndarray, "sample dof"],
        squares: Squares | None,
    ) -> Assessed:
        if squares is None:  # the replay exploded
            bad = np.full(self.channels.floors.shape, np.inf)
            return Assessed(hypothesis, -np.inf, bad, np.zeros(len(centre)), centre, error, raw)
        sizes, box = self._around.centre, boxes(self.tolerances, hypothesis)
        variance = self.channels.variance(squares.total)
        for _ in range(3):
            sizes = self._adapt(squares, variance, box, sizes)
            variance = self.channels.variance(squares.left(sizes))
        loglik = self.channels.nats(variance) - 0.5 * float(sizes @ sizes)
        return Assessed(hypothesis, loglik, variance, sizes, centre, error, raw)

    def left(self, assessed: Assessed) -> Float[np.ndarray, "sample dof"]:
        """The error once the tolerances have adapted."""
        return self.adapted(assessed.error, assessed.tolerances)

    def adapted(
        self, error: Float[np.ndarray, "sample dof"], sizes: Float[np.ndarray, " tolerance"]
    ) -> Float[np.ndarray, "sample dof"]:
        """A projected error with tolerances of such sizes [deviations]."""
        return np.asarray(error + self._around.moved(sizes))

    def errors(
        self, hypotheses: Sequence[Hypothesis], centres: Sequence[Float[np.ndarray, " tolerance"]]
    ) -> Float[np.ndarray, "hypothesis sample dof"]:
        """Errors of the replays that :meth:`evaluate` assesses; nothing has adapted."""
        return self._with(hypotheses, centres)[0]

    def change(
        self, now: Assessed, others: Sequence[Float[np.ndarray, "sample dof"]]
    ) -> Float[np.ndarray, "sample dof other"]:
        """Change of the projected error to errors of hypotheses close by, to first order."""
        changes = [other - now.raw for other in others]
        stacked = np.stack(changes, axis=2) if changes else np.zeros((*now.raw.shape, 0))
        return project_changes(now.raw, stacked, self._around.initial)

    def sharper(self) -> Objective:
        """The same replays, judged below noise.

        What tells hypotheses apart forgives what no machine follows exactly, and what noise makes,
        of which nobody knows to a per cent how much it is: below it all are as good, and the best
        figures of one of them are not found. On legs more than noise is left whatever they are.
        """
        if self.scene.free:
            return self
        floors = np.broadcast_to(_SHARP * self.noise, self.channels.floors.shape)
        return self.judged(replace(self.channels, floors=floors))

    def only(self, rows: Bool[np.ndarray, " sample"]) -> Objective:
        """The same replays, judged by some of the samples."""
        return self.judged(self.channels.only(rows))

    def judged(self, channels: Channels) -> Objective:
        """The same replays, judged by channels of their own, with references of their own."""
        other = copy.copy(self)
        other._replays, other._reference = self._replays.apart(), None
        other._nearby = self._nearby.on(other._replays)
        other.channels = channels
        return other

    def calibration(self, assessed: Assessed) -> Hypothesis:
        """The tolerances as small corrections of the model, without those that it cannot hold.

        Nor those that are of the kind and place of an effect, which says it for both.
        """
        able = np.flatnonzero(self._able & ~alike(self.tolerances, assessed.hypothesis))
        squares = self._around.squares(assessed.error[None])[0].only(able)
        box = boxes(self.tolerances, assessed.hypothesis)[able]
        sizes = self._adapt(squares, assessed.variance, box)
        pairs = [(self.tolerances[i], float(x)) for i, x in zip(able, sizes, strict=True)]
        return tuple(tolerance.scaled(x) for tolerance, x in pairs if abs(x) > _WORTHWHILE)

    def _adapt(
        self,
        squares: Squares,
        variance: Float[np.ndarray, "part dof"],
        box: Float[np.ndarray, " tolerance"],
        near: Float[np.ndarray, " tolerance"] | None = None,
    ) -> Float[np.ndarray, " tolerance"]:
        """Tolerances inside their boxes [deviations]."""
        return squares.inside(self.channels.weights(variance), box, near)

    def solve(
        self,
        now: Assessed,
        jacobian: Float[np.ndarray, "sample dof parameter"],
        lower: Float[np.ndarray, " parameter"],
        upper: Float[np.ndarray, " parameter"],
        damping: float,
        prior_std: Float[np.ndarray, " parameter"] | float = np.inf,
    ) -> tuple[Float[np.ndarray, " tolerance"], Float[np.ndarray, " parameter"]]:
        """One bounded Gauss-Newton step of parameters and tolerances together.

        Args:
            now: where the step is taken from.
            jacobian: of the error in the parameters.
            lower: smallest step.
            upper: largest step.
            damping: Levenberg-Marquardt, relative to the diagonal.
            prior_std: spread of a prior on each step.

        Returns:
            (tolerances [deviations], step of the parameters).
        """
        squares = self._around.squares_beside(now.error, jacobian)
        p, size = jacobian.shape[2], boxes(self.tolerances, now.hypothesis)
        low, high = np.concatenate([lower, -size]), np.concatenate([upper, size])
        prior = np.concatenate([np.full(p, 1.0) / np.square(prior_std), np.ones(len(size))])
        damped = np.concatenate([np.full(p, damping), np.zeros(len(size))])
        x = squares.step(self.channels.weights(now.variance), low, high, prior, damped)
        return rounded(x[p:], size), x[:p]

    @property
    def nudge(self) -> float:
        """Factor by which finite differences are larger than where replays are smooth."""
        return self._nearby.nudge

    @property
    def columns(self) -> Float[np.ndarray, "sample dof tolerance"]:
        """Change of the error per deviation of each tolerance."""
        return self._around.columns

    def numerical_error(self, reference: Assessed) -> Float[np.ndarray, "sample dof"]:
        """What the steps' length may still do to replays of the reference, projected.

        Where feet land, errors go with no power of a step: half of what was extrapolated is left.
        """
        if self.scene.free:
            left = 0.5 * self._replays.of(reference.hypothesis).correction
        else:
            here = (*reference.hypothesis, *self._nearby.rig(reference.centre))
            left = self._replays.of(here).unsettled(here)
        valid = np.where(self.channels.valid, left, 0.0)[:, :, None]
        return project_changes(reference.raw, valid, self._around.initial)[:, :, 0]
