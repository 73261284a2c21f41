"""Recordings, fitted and held out, and the replays that each stage asks of them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from wt.diagnose.effort import Effort, effort_of
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.sets import objective_on
from wt.diagnose.likelihood.steps import Steps, longest_steps, shortest
from wt.diagnose.pace import Pace
from wt.diagnose.recordings.commands import smooth_as_sent
from wt.diagnose.recordings.prepare import Prepared
from wt.diagnose.recordings.smooth import Smoothed, beside, smooth
from wt.diagnose.recordings.stretches import BLOCK_S, WINDOW_S, longest_window, stretches_of
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.holdout import Holdout, prepare_holdout
from wt.diagnose.selection.naming import Naming
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene


def steps_for(sets: Sequence[Smoothed], window: float | None) -> Steps | None:
    """Steps that do where no law is stiff; None where nothing tells longer ones than usual.

    They do for each set of recordings: one of them may jump where the others move smoothly. A
    machine that forgets errs in short windows as it does in long ones, and many short ones are
    stepped side by side.
    """
    scene = sets[0].motion.scene
    if scene.free:
        return None
    effort = effort_of(scene)
    each = effort.search_s / len(sets)
    pairs = [(s, stretches_of(s, False, each, window=window)) for s in sets]
    return shortest([longest_steps(*pair, effort.step) for pair in pairs])


@dataclass(frozen=True, eq=False)
class Split:
    """Recordings of one machine, smoothed, and what replays them.

    Attributes:
        prepared: what they are of.
        fitted: those that are fitted.
        held_out: those that decide.
        forgetting: whether the machine forgets its initial state.
        screen: the force residual of the fitted ones.
        known: effects that the model lacks, beside whose response to commands states are read.
        seed: of everything random.
        log: grows by every decision.
    """

    prepared: Prepared
    fitted: Smoothed
    held_out: Smoothed
    forgetting: bool
    screen: Screen
    seed: int
    log: DecisionLog
    known: Hypothesis = ()

    @property
    def scene(self) -> Scene:
        """The machine."""
        return self.fitted.motion.scene

    @property
    def effort(self) -> Effort:
        """What it is worth."""
        return effort_of(self.scene)

    def longest(self, hypothesis: Hypothesis = ()) -> float:
        """See :func:`longest_window`, of the fitted recordings."""
        return longest_window(self.fitted, self.effort.search_step, hypothesis)

    @functools.cached_property
    def steps(self) -> Callable[[float | None], Steps | None]:
        """See :func:`steps_for`, asked once for each window."""
        return functools.cache(functools.partial(steps_for, (self.fitted, self.held_out)))

    @functools.cached_property
    def held(self) -> Callable[[float, float | None], Holdout]:
        """See :func:`prepare_holdout`: so many seconds, in windows of a length; prepared once."""
        of = self.held_out, self.forgetting
        return functools.cache(
            lambda seconds, window: prepare_holdout(*of, seconds, window, self.steps(window))
        )

    def replays(
        self,
        sets: Sequence[Smoothed],
        seconds: float,
        step: float,
        window: float | None,
        length: float | None = None,
    ) -> Objective:
        """Replays of so many seconds of some recordings, with steps that do for the windows.

        Args:
            sets: the recordings.
            seconds: of them, at most.
            step: physics step [s].
            window: length of windows [s]; None where the machine forgets or floats.
            length: of these replays, where it is another.
        """
        steps = self.steps(window)
        return objective_on(sets, self.forgetting, seconds, step, length or window, steps)

    def naming(self, window: float | None) -> Naming:
        """What makes the claims, by replays in windows of a length [s]."""
        effort, forgetting = self.effort, self.forgetting
        step, quick = effort.step, effort.search_step
        both = [self.fitted, self.held_out]
        short = BLOCK_S if forgetting else window  # figures are of long replays
        judge_s = self._judged_s
        return Naming(
            self.screen,
            self.replays([self.fitted], effort.search_s, quick, window, short),
            self.replays([self.fitted], effort.most_s, step, window),
            functools.cache(lambda: self.replays(both, effort.doubt_s, quick, window)),
            self.held(judge_s, window),
            step,
            self.seed,
            self.log,
            functools.partial(self.held, judge_s, None) if window and window > WINDOW_S else None,
        )

    def beside(self, known: Hypothesis) -> Split:
        """The same with states that are read beside the response of the machine as it was found.

        The very same where that moves no state of the fitted recordings.
        """
        fitted = beside(self.fitted, self.prepared.fit, known)
        if fitted is self.fitted:
            return self
        held_out = beside(self.held_out, self.prepared.held, known)
        return replace(self, fitted=fitted, held_out=held_out, known=known)

    def whole(self) -> Smoothed:
        """All recordings, none held out."""
        of = self.fitted
        return smooth(self.scene, self.prepared.whole, of.commands, of.begun, self.known)

    @property
    def _judged_s(self) -> float:
        """Seconds of held-out recordings that effects are proven on.

        Where these are all, they are those of the proof, with what is known of them by then.
        """
        lasting, effort = sum(float(s.t[-1] - s.t[0]) for s in self.held_out.samples), self.effort
        return effort.judge_s if lasting > effort.judge_s else effort.proof_s


def split_of(scene: Scene, prepared: Prepared, seed: int, log: DecisionLog, pace: Pace) -> Split:
    """Smooth and screen prepared recordings.

    Args:
        scene: the machine.
        prepared: its recordings.
        seed: of everything random.
        log: grows by every decision.
        pace: is told of each stage.

    Raises:
        RecordingError: a recording cannot be used.
    """
    pace.stage("smoothing")
    effort = effort_of(scene)
    fitted, forgetting = smooth_as_sent(scene, prepared.fit, effort.step, effort.search_step)
    held_out = smooth(scene, prepared.held, fitted.commands, fitted.begun)
    pace.stage("screening hypotheses")
    return Split(prepared, fitted, held_out, forgetting, Screen(fitted, seed), seed, log)
