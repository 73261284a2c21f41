"""``diagnose``: the steps in order, and nothing else."""

from __future__ import annotations

import functools
import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wt.check.finding import amendments
from wt.diagnose.experiment.release import passive, release
from wt.diagnose.likelihood.bic import erring, erring_joints
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.sets import objective_on
from wt.diagnose.likelihood.steps import Steps, longest_steps
from wt.diagnose.notes import notes
from wt.diagnose.observed.forces import measured
from wt.diagnose.observed.translation import TrainedTranslation, sentences, timed, translated
from wt.diagnose.pace import Expected, Pace, Say
from wt.diagnose.recordings.commands import smooth_as_sent
from wt.diagnose.recordings.grid import coarse_steps, located
from wt.diagnose.recordings.prepare import Prepared, Source, prepare, turned
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import BLOCK_S, WINDOW_S, longest_window, stretches_of
from wt.diagnose.report.handed_over import hand_over
from wt.diagnose.report.traces import traces
from wt.diagnose.report.verify import replayed_files
from wt.diagnose.residual.screen import Screen
from wt.diagnose.result import Diagnosis
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.events import Event, events
from wt.diagnose.selection.holdout import Holdout, errors, prepare_holdout, prove
from wt.diagnose.selection.locate import locate
from wt.diagnose.selection.naming import Naming
from wt.diagnose.selection.search import search
from wt.diagnose.selection.verdict import (
    findings,
    left_over,
    shown_by_holdout,
    suggestions,
    verdict,
)
from wt.diagnose.stop import stopped
from wt.diagnose.unvisited import unvisited
from wt.mjcf.edit import patched_xml
from wt.physics.planted import Hypothesis, Key
from wt.physics.quiet import quiet
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

STEP_S = 5e-4
"""Fine physics step of replays [s]; the model's own, if that is smaller."""


@dataclass(frozen=True)
class Effort:
    """Steps and seconds of replays.

    Attributes:
        step: fine physics step [s]; the model's own, if that is smaller.
        search_step: … and while hypotheses are compared.
        search_s: at most so many seconds of recordings are replayed while these are compared.
        doubt_s: … while each of what was found is compared with its lookalikes.
        most_s: … and to estimate.
        judge_s: … and to prove each effect, of those held out.
        proof_s: … and to measure how much better all of them together do.
    """

    step: float
    search_step: float
    search_s: float
    doubt_s: float
    most_s: float
    judge_s: float
    proof_s: float


FIXED = Effort(STEP_S, 1e-3, 16.0, 60.0, 60.0, 60.0, np.inf)
FLOATING = Effort(1e-3, 1e-3, 5.0, 8.0, 16.0, 16.0, 16.0)
"""Steps with contacts cost several times as much, and there are many more of them to choose."""
_FAR_MORE = 1.5
"""Mean square error of a joint, over another, that is no refinement any more."""
_ADDED = 0.5
"""Noise that a time step may add: a quarter more of the squared error, where nothing is left."""
ATTEMPTS = 3
"""At most this many searches, each without the effects that held-out data refused before."""
_CUT_SHORT = "The search was ended before its time: there may be more than what it had found."


@quiet()  # what is wrong with a model is an error of one line, and many a replay explodes
def diagnose(
    model: str | Path,
    recordings: Sequence[Source],
    holdout: Sequence[Source] = (),
    *,
    seed: int = 0,
    progress: Say | None = None,
    expect: Callable[[Expected], None] | None = None,
    translation: TrainedTranslation | None = None,
    log: DecisionLog | None = None,
) -> Diagnosis:
    """Find what a model leaves out, from recordings of the real machine.

    Args:
        model: an MJCF file.
        recordings: what to fit: Parquet files of the recording format, or recordings.
        holdout: recordings for the proof only. Without any, the last of several recordings is
            held out, or the last quarter of a single one.
        seed: of everything random.
        progress: called as the work goes on.
        expect: called after the audit with how long the whole will take, and again where it
            turns out otherwise.
        translation: trained between this model and the machine; says when something hidden acted
            where nothing else does, and what it cannot recover.
        log: grows by every decision, for those who watch; it is empty.

    Raises:
        ModelError: the MJCF cannot be used, or the translation is of another machine.
        RecordingError: a recording cannot be used.
    """
    began, pace = time.monotonic(), Pace(progress, expect)
    scene, prepared = audited(model, recordings, holdout, pace)
    translation_evidence = translated(scene, prepared, translation) if translation else None
    log = DecisionLog() if log is None else log
    outcome = searched(scene, prepared, seed, log, pace)
    outcome, note = _in_turns(scene, prepared, outcome, seed, log, pace)
    pace.stage("preparing pictures")
    diagnosis = told(scene, outcome)
    return replace(
        diagnosis,
        locations=timed(diagnosis.locations, translation_evidence),
        translated=translation_evidence,
        notes=(
            *diagnosis.notes,
            *note,
            *((_CUT_SHORT,) if stopped() else ()),
            *(sentences(translation_evidence) if translation_evidence else ()),
        ),
        seconds=time.monotonic() - began,
    )


def audited(
    model: str | Path, recordings: Sequence[Source], holdout: Sequence[Source], pace: Pace
) -> tuple[Scene, Prepared]:
    """The model and the recordings as corrected; as given they say how long all will take."""
    pace.stage("auditing")
    scene = Scene(model)
    effort = effort_of(scene)
    foretell = functools.partial(pace.foretell, scene, effort.search_step, effort.search_s)
    prepared = prepare(scene, recordings, holdout, foretell)
    changes = amendments(prepared.audit)
    return (Scene(model, changes) if changes else scene), prepared


def effort_of(scene: Scene) -> Effort:
    """What a machine is worth, in steps that are no longer than the model's own."""
    effort = FLOATING if scene.free else FIXED
    own = float(scene.model.opt.timestep)
    return replace(effort, step=min(effort.step, own), search_step=min(effort.search_step, own))


def steps_for(smoothed: Smoothed, window: float | None) -> Steps | None:
    """Steps that do where no law is stiff; None where nothing tells longer ones than usual.

    A machine that forgets errs in short windows as it does in long ones, and many short ones are
    stepped side by side.
    """
    scene = smoothed.motion.scene
    if scene.free:
        return None
    effort = effort_of(scene)
    pairs = stretches_of(smoothed, False, effort.search_s, window=window)
    return longest_steps(smoothed, pairs, effort.step)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was found with some recordings held out.

    Attributes:
        prepared: the recordings.
        fitted: those that were fitted, smoothed.
        naming: what the claims are made by.
        holdout: held-out recordings that the proof is measured on.
        claims: what is claimed.
        missed: the same on the held-out recordings, and their replays, where these err although
            the fitted ones leave nothing open.
    """

    prepared: Prepared
    fitted: Smoothed
    naming: Naming
    holdout: Holdout
    claims: Claims
    missed: tuple[Assessed, Objective] | None

    @property
    def names(self) -> set[Key]:
        """Effects that are claimed, and their places."""
        return {a.planted.key for a in self.claims.accepted}


def searched(
    scene: Scene, prepared: Prepared, seed: int, log: DecisionLog, pace: Pace, attempts: int = 0
) -> Outcome:
    """Search the fitted recordings and ask the held-out ones, which were asked before so often."""
    pace.stage("smoothing")
    effort = effort_of(scene)
    fitted, forgetting = smooth_as_sent(scene, prepared.fit, effort.step, effort.search_step)
    step, quick = effort.step, effort.search_step
    held_out = smooth(scene, prepared.held, fitted.commands, fitted.begun)
    pace.stage("screening hypotheses")
    screen = Screen(fitted, seed)

    steps = functools.cache(functools.partial(steps_for, fitted))
    held = functools.cache(functools.partial(prepare_holdout, held_out, forgetting, step=step))
    judge_s = _judged_s(held_out, effort)

    def naming_by(window: float | None) -> Naming:
        def of(
            sets: Sequence[Smoothed], seconds: float, step: float, length: float | None = window
        ) -> Objective:
            return objective_on(sets, forgetting, seconds, step, length, steps(window))

        all_replays = functools.cache(lambda: of([fitted, held_out], effort.doubt_s, quick))
        short = BLOCK_S if forgetting else window  # figures are of long replays
        replays = of([fitted], effort.search_s, quick, short), of([fitted], effort.most_s, step)
        shorter = functools.partial(held, judge_s) if window and window > WINDOW_S else None
        judged = held(judge_s, window=window)
        return Naming(screen, *replays, all_replays, judged, step, seed, log, shorter)

    window = None if forgetting or scene.free else longest_window(fitted, quick)
    naming = naming_by(window)
    if any(f.voids_commands for f in prepared.audit):
        measured_on = held(effort.proof_s, window=window)
        return Outcome(prepared, fitted, naming, measured_on, naming.proven(()), None)
    pace.time(naming.search_replays)
    accepted = search(screen, naming.search_replays, log, pace.search)
    if window and not stopped():
        longest = functools.partial(longest_window, fitted, quick)
        window, naming, accepted = _prolonged(naming, accepted, window, longest, naming_by, pace)
    proven = _proven(naming, accepted, pace, attempts)
    pace.stage("looking for events")
    seen: tuple[Event, ...] = ()
    # a servo holds against a push and forgets it, and of what feet meet nothing is known
    if not forgetting and not scene.free:
        whole = smooth(scene, prepared.whole, fitted.commands, fitted.begun)
        all_of_it = functools.partial(objective_on, [whole], False, effort.most_s, quick)
        seen = events(whole.motion, all_of_it, proven.estimated.hypothesis, log)
    pace.stage("naming")
    claims, missed = naming.claimed(replace(proven, events=seen)), None
    # replays of legs are asked by the proof alone: they would cost a search
    if not scene.free and verdict(claims, naming.objective) in ("no_mismatch", "explained"):
        long = steps(window)
        replays = objective_on([held_out], forgetting, effort.most_s, step, window, long)
        # it is the same machine: its tolerances begin as the fitted recordings have them
        known = claims.assessed(naming.objective).tolerances
        assessed = replays.reference(naming.holdout.here(claims.hypothesis), known)
        missed = (assessed, replays) if erring(assessed, replays) else None
    return Outcome(prepared, fitted, naming, held(effort.proof_s, window=window), claims, missed)


def _judged_s(held_out: Smoothed, effort: Effort) -> float:
    """Seconds of held-out recordings that effects are proven on.

    Where these are all, they are those of the proof, with what is known of them by then.
    """
    lasting = sum(float(s.t[-1] - s.t[0]) for s in held_out.samples)
    return effort.judge_s if lasting > effort.judge_s else effort.proof_s


def _in_turns(
    scene: Scene, prepared: Prepared, outcome: Outcome, seed: int, log: DecisionLog, pace: Pace
) -> tuple[Outcome, tuple[str, ...]]:
    """What is found with others held out, where those held out show more; and a note of it."""
    others = outcome.missed and not stopped() and turned(prepared)
    if not others:
        return outcome, ()
    pace.stage("recordings take turns")
    again = searched(scene, others, seed, log, pace, attempts=1)
    new = again.names - outcome.names
    if not new:
        return outcome, ()
    said = ", ".join(str(a.planted) for a in again.claims.accepted if a.planted.key in new)
    unfitted = " and ".join(f"'{u.path}'" for u in prepared.used if u.role == "holdout")
    return again, (f"Of the recordings, which took turns, only {unfitted} shows {said}.",)


def told(scene: Scene, outcome: Outcome) -> Diagnosis:
    """The claims, with all that a report shows of them."""
    diagnosis = _diagnosis(scene, outcome)
    if outcome.missed:
        diagnosis = shown_by_holdout(diagnosis, *outcome.missed)
    return replace(diagnosis, audit=outcome.prepared.audit, decisions=tuple(outcome.naming.log))


def _diagnosis(scene: Scene, outcome: Outcome) -> Diagnosis:
    """The claims on the fitted recordings."""
    prepared, naming, claims = outcome.prepared, outcome.naming, outcome.claims
    holdout = outcome.holdout
    timestep = STEP_S if _too_coarse(scene, holdout, claims) else None
    units = {j: units_at(scene, Location("joint", j)) for j in scene.joints}
    quantized = coarse_steps(prepared.fit, prepared.held, units)
    where = claims.unexplained(naming.objective)
    shown = traces(prepared, (outcome.fitted, holdout.smoothed), claims.complete, naming.step)
    commanded = not any(f.voids_commands for f in prepared.audit)
    nameless = left_over(claims, naming.objective) if commanded else ()
    experiment = release(scene, shown) if passive(scene) else ""
    all_findings = (*findings(claims, scene, experiment), *nameless, *quantized)
    said = verdict(claims, naming.objective, quantized)
    further = measured(
        prepared, naming.screen, holdout, claims.complete, naming.step, said != "no_mismatch"
    )
    written = claims.patch, claims.comments(scene)
    files = hand_over(holdout, claims.complete, written, prepared.names, timestep)
    given_xml = patched_xml(scene, (), ())
    replays = replayed_files(files.contents, given_xml)
    beyond = unvisited(outcome.fitted, holdout, replays.physics)
    return Diagnosis(
        model_path=str(scene.path),
        model_sha256=hashlib.sha256(scene.path.read_bytes()).hexdigest(),
        joints=scene.joints,
        units=tuple(u.position for u in units.values()),
        recordings=prepared.used,
        verdict=said,
        locations=(
            *locate(
                naming.screen,
                claims.hypothesis,
                claims.shares,
                unexplained=where,
                names=prepared.names,
            ),
            *located(quantized, alone=not claims.hypothesis),
        ),
        findings=all_findings,
        proof=prove(
            holdout,
            claims.complete,
            naming.step,
            prepared.split,
            naming.seed,
            (replays.before, replays.physics, replays.model),
        ),
        given_xml=given_xml,
        patched_xml=files.model_xml,
        traces=shown,
        suggestions=suggestions(all_findings),
        measured=further,
        notes=(*notes(holdout, claims, timestep, beyond), *further.notes),
        residual_onnx=files.residual_onnx,
        physics_py=files.physics_py,
        holdout_npz=files.holdout_npz,
    )


def _prolonged(
    naming: Naming,
    accepted: tuple[Accepted, ...],
    window: float,
    longest: Callable[[Hypothesis], float],
    naming_by: Callable[[float], Naming],
    pace: Pace,
) -> tuple[float, Naming, tuple[Accepted, ...]]:
    """Search on in longer windows, where something is left and what was found allows them.

    It may keep replays beside the recordings for longer, which tells what else there is.

    Args:
        naming: of what was found.
        accepted: what was found.
        window: length of the windows that it was found in [s].
        longest: length of the longest windows for a hypothesis [s].
        naming_by: makes the claims of windows of a length [s].
        pace: is told of each stage.

    Returns:
        (length of the windows; what makes the claims; what is found), as given or later.
    """
    given = window, naming, accepted
    replays, hypothesis = naming.search_replays, tuple(a.planted for a in accepted)
    if not accepted or not erring_joints(replays, replays.reference(hypothesis)):
        return given
    later = longest(hypothesis)
    if later <= window:
        return given
    longer = naming_by(later)
    further = search(naming.screen, longer.search_replays, naming.log, pace.search, accepted)
    return given if _lost(replays, accepted, further) else (later, longer, further)


def _lost(replays: Objective, before: Sequence[Accepted], after: Sequence[Accepted]) -> bool:
    """Tell whether longer windows led away from what shorter ones had found.

    There the errors of a rig bend replays so much that a fit may stop on its way; the shorter ones
    then err far more by what it says.
    """
    two = [replays.reference(tuple(a.planted for a in found)).mse for found in (before, after)]
    return bool((two[1] > _FAR_MORE * two[0]).any())


def _proven(naming: Naming, accepted: tuple[Accepted, ...], pace: Pace, before: int = 0) -> Claims:
    """Prove what was found; where the proof drops effects and leaves errors, search for others.

    What is proven first stays unless what is proven later is more likely: what a later search added
    may have taken the place of a proven effect, and then be refused itself.

    Args:
        naming: makes the claims.
        accepted: what was found.
        pace: is told of each stage.
        before: proofs on the same recordings, before these.
    """
    screen, replays, log = naming.screen, naming.search_replays, naming.log
    banned, kept, best = set[Key](), set[Key](), None
    for attempt in range(1, ATTEMPTS + 1):
        pace.stage("estimating and proving")
        proven = naming.proven(accepted, before + attempt, kept)
        # fewer, not others: an effect that a simpler law says as well was not refused
        refused = len(proven.accepted) < len(accepted)
        best = proven = naming.further(best, proven) if best else proven
        if not refused or attempt == ATTEMPTS or stopped() or naming.clean(proven):
            break
        kept = {a.planted.key for a in proven.accepted}
        banned |= {a.planted.key for a in accepted} - kept
        accepted = search(screen, replays, log, pace.search, proven.accepted, banned)
    return proven


def _too_coarse(scene: Scene, holdout: Holdout, claims: Claims) -> bool:
    """True if the model's own time step adds to the error, by more than half of the noise.

    Where it is itself a part of what was recorded, as in another simulator's robot, it adds none.
    """
    own = float(scene.model.opt.timestep)
    if own <= STEP_S:
        return False
    coarse, fine = (errors(holdout, [claims.hypothesis], h)[0] for h in (own, STEP_S))
    count = np.maximum(np.isfinite(fine).sum(axis=0), 1)
    added = np.sqrt(np.nansum((coarse - fine) ** 2, axis=0) / count)
    worse = np.nansum(coarse**2, axis=0) > np.nansum(fine**2, axis=0)
    return bool((worse & (added > _ADDED * holdout.smoothed.noise)).any())
