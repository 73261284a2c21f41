"""``diagnose``: the steps in order, and nothing else."""

from __future__ import annotations

import functools
import hashlib
import time
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wt.check.finding import amendments
from wt.diagnose.effort import STEP_S, effort_of
from wt.diagnose.experiment.release import passive, release
from wt.diagnose.likelihood.bic import erring, erring_joints
from wt.diagnose.likelihood.moments import momentary
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.sets import objective_on
from wt.diagnose.notes import notes
from wt.diagnose.observed.forces import measured
from wt.diagnose.observed.translation import TrainedTranslation, sentences, timed, translated
from wt.diagnose.pace import Expected, Pace, Say
from wt.diagnose.recordings.grid import coarse_steps, located
from wt.diagnose.recordings.prepare import Prepared, Source, prepare, turned
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.report.handed_over import hand_over
from wt.diagnose.report.traces import traces
from wt.diagnose.report.verify import replayed_files
from wt.diagnose.result import Diagnosis
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.events import Event, events
from wt.diagnose.selection.holdout import Holdout, errors
from wt.diagnose.selection.locate import locate
from wt.diagnose.selection.naming import Naming
from wt.diagnose.selection.proof import prove
from wt.diagnose.selection.search import search
from wt.diagnose.selection.verdict import (
    findings,
    left_over,
    shown_by_holdout,
    suggestions,
    verdict,
)
from wt.diagnose.split import Split, split_of
from wt.diagnose.stop import stopped
from wt.diagnose.unvisited import unvisited
from wt.mjcf.edit import patched_xml
from wt.physics.planted import Key
from wt.physics.quiet import quiet
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

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


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was found with some recordings held out.

    Attributes:
        prepared: the recordings.
        fitted: those that were fitted, smoothed.
        naming: what the claims are made by.
        holdout: held-out recordings that the proof is measured on.
        claims: what is claimed.
        missed: the same on the held-out recordings, their replays, and joints that err at moments,
            where these err although the fitted ones leave nothing open.
    """

    prepared: Prepared
    fitted: Smoothed
    naming: Naming
    holdout: Holdout
    claims: Claims
    missed: tuple[Assessed, Objective, Container[str]] | None

    @property
    def names(self) -> set[Key]:
        """Effects that are claimed, and their places."""
        return {a.planted.key for a in self.claims.accepted}


def searched(
    scene: Scene, prepared: Prepared, seed: int, log: DecisionLog, pace: Pace, attempts: int = 0
) -> Outcome:
    """Search the fitted recordings and ask the held-out ones, which were asked before so often."""
    split = split_of(scene, prepared, seed, log, pace)
    effort, forgetting = split.effort, split.forgetting
    window = None if forgetting or scene.free else split.longest()
    naming = split.naming(window)
    if any(f.voids_commands for f in prepared.audit):
        measured_on = split.held(effort.proof_s, window)
        return Outcome(prepared, split.fitted, naming, measured_on, naming.proven(()), None)
    pace.time(naming.search_replays)
    given = split.screen, naming.search_replays, log, pace.search
    accepted = search(*given, memory=naming.memory)
    if window and not stopped():
        window, naming, accepted = _prolonged(split, naming, accepted, window, pace)
    if not stopped():
        split, naming, accepted = _read_again(split, naming, accepted, window, pace)
    proven = _proven(naming, accepted, pace, attempts)
    pace.stage("looking for events")
    seen: tuple[Event, ...] = ()
    # a servo holds against a push and forgets it, and of what feet meet nothing is known
    if not forgetting and not scene.free:
        whole, quick = split.whole(), effort.search_step
        all_of_it = functools.partial(objective_on, [whole], False, effort.most_s, quick)
        seen = events(whole.motion, all_of_it, proven.estimated.hypothesis, log)
    pace.stage("naming")
    claims, missed = naming.claimed(replace(proven, events=seen)), None
    # replays of legs are asked by the proof alone: they would cost a search
    said = verdict(claims, naming.objective)
    if not scene.free and said in ("no_mismatch", "explained"):
        replays = split.replays([split.held_out], effort.most_s, effort.step, window)
        # it is the same machine: its tolerances begin as the fitted recordings have them
        known = claims.assessed(naming.objective).tolerances
        assessed = replays.reference(naming.holdout.here(claims.hypothesis), known)
        surely = momentary(replays, assessed) if said == "no_mismatch" else {}
        missed = (assessed, replays, surely) if erring(assessed, replays, surely) else None
    measured_on = split.held(effort.proof_s, window)
    return Outcome(prepared, split.fitted, naming, measured_on, claims, missed)


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
    split: Split, naming: Naming, accepted: tuple[Accepted, ...], window: float, pace: Pace
) -> tuple[float, Naming, tuple[Accepted, ...]]:
    """Search on in longer windows, where something is left and what was found allows them.

    It may keep replays beside the recordings for longer, which tells what else there is.

    Args:
        split: the recordings.
        naming: of what was found.
        accepted: what was found.
        window: length of the windows that it was found in [s].
        pace: is told of each stage.

    Returns:
        (length of the windows; what makes the claims; what is found), as given or later.
    """
    given = window, naming, accepted
    replays, hypothesis = naming.search_replays, tuple(a.planted for a in accepted)
    if not accepted or not erring_joints(replays, replays.reference(hypothesis)):
        return given
    later = split.longest(hypothesis)
    if later <= window:
        return given
    longer = split.naming(later)
    more = naming.screen, longer.search_replays, naming.log, pace.search, accepted
    further = search(*more, memory=longer.memory)
    return given if _lost(replays, accepted, further) else (later, longer, further)


def _read_again(
    split: Split,
    naming: Naming,
    accepted: tuple[Accepted, ...],
    window: float | None,
    pace: Pace,
) -> tuple[Split, Naming, tuple[Accepted, ...]]:
    """Search on with states beside the response of the machine as it was found.

    Where its inertia or its drives are others than the model's, states were off and noise was
    overestimated, which hides what is faint.

    Args:
        split: the recordings.
        naming: of what was found.
        accepted: what was found.
        window: length of the windows that it was found in [s], if there are any.
        pace: is told of each stage.

    Returns:
        (the recordings; what makes the claims; what is found), as given where states stay.
    """
    again = split.beside(tuple(a.planted for a in accepted))
    if again is split:
        return split, naming, accepted
    naming = again.naming(window)
    more = again.screen, naming.search_replays, naming.log, pace.search, accepted
    further = search(*more, memory=naming.memory)
    return again, naming, further


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
        given = screen, replays, log, pace.search, proven.accepted, banned
        accepted = search(*given, naming.memory)
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
