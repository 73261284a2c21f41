"""Diagnose three real machines, and compare with figures that are published for them.

Recordings are split by motion: a motion is fitted or held out, never both. One table a machine:
what was found, and the errors of open-loop replays of the held-out motions, joint by joint, with
the rigid model as it is before, with the best published parameters, and with the findings.

Usage: python benchmarks/real.py --machine so101|double_pendulum|servo_bench [--fit MOTION …]
           [--holdout MOTION …] [--seconds S] [--seed S] [--recordings DIR] [--out DIR]
           [--rival sysid]

``--seconds`` cuts each recording to its first S seconds. ``--out`` writes the report too. For the
servo bench one more line a log replays the findings at a firmware gain that was not fitted. The
rival fits armature, damping, dry friction and gain of every joint to the same recordings.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wt.diagnose.pipeline import STEP_S, diagnose
from wt.diagnose.recordings.prepare import unsplit
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.report.write import write
from wt.diagnose.result import Diagnosis, Finding
from wt.diagnose.selection.holdout import Holdout, errors, prepare_holdout
from wt.errors import UserError, WorkError
from wt.physics.effect import Parameter, effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.prove.machines.base import between, machines
from wt.prove.sysid_rival import Fitted, Rival, every_parameter
from wt.types import Location, Recording
from wt.worlds.rigs import spec_for, write_mjcf
from wt.worlds.so101_model import ARM_JOINTS

Array = np.ndarray

RECORDINGS = Path(__file__).resolve().parents[1].parent / "shared" / "recordings"


@dataclass(frozen=True)
class Known:
    """What is known of a machine elsewhere.

    Attributes:
        joints: that a machine's mean is taken over.
        published: (effect, joint, theta) to compare with, on top of the rigid model.
        reference: what those parameters are called.
        elsewhere: motions of other set-ups, on which the findings are replayed.
    """

    joints: tuple[str, ...]
    published: tuple[tuple[str, str, float], ...]
    reference: str
    elsewhere: tuple[str, ...] = ()


_STOCK_FRICTION, _STOCK_DELAY = 0.3 - 0.052, 0.020  # N·m beyond the model's own; s

KNOWN = {
    "so101": Known(
        ARM_JOINTS,
        tuple(
            part
            for joint in ARM_JOINTS
            for part in (
                ("joint.friction_coulomb", joint, _STOCK_FRICTION),
                ("actuator.delay", joint, _STOCK_DELAY),
            )
        ),
        "stock: frictionloss .3, delay 20 ms",
    ),
    "double_pendulum": Known(
        ("shoulder", "elbow"),
        (
            ("joint.friction_coulomb", "shoulder", 0.16),
            ("joint.friction_viscous", "shoulder", 0.001),
            ("joint.friction_coulomb", "elbow", 0.12),
            ("joint.friction_viscous", "elbow", 0.001),
        ),
        "published friction",
    ),
    "servo_bench": Known(
        ("hinge",),
        (
            ("joint.friction_coulomb", "hinge", 0.01283272036582759),
            ("joint.friction_viscous", "hinge", 0.003661672282824312),
            ("joint.armature", "hinge", 0.0018141672784458866),
        ),
        "published m1",
        elsewhere=(
            "kp100_sin_sin", "kp100_up_and_down", "kp100_sin_time_square", "kp100_lift_and_drop",
            "kp400_sin_sin", "kp400_up_and_down", "kp400_sin_time_square", "kp400_lift_and_drop",
        ),
    ),
}  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Print a machine's tables; 0 if its diagnosis came back."""
    args = _arguments(argv)
    machine, known = machines()[args.machine], KNOWN[args.machine]
    fit_names, held_names = args.fit or machine.fit, args.holdout or machine.holdout
    both = sorted(set(fit_names) & set(held_names))
    try:
        if both:
            raise UserError(f"'{both[0]}' is both fitted and held out; a motion can be one only")
        seconds = args.seconds or np.inf
        fit, held = (
            [between(machine.read(args.recordings, name), 0.0, seconds) for name in names]
            for names in (fit_names, held_names)
        )
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            model = Path(scratch) / f"{args.machine}.xml"
            write_mjcf(machine.given(), model)
            found = diagnose(model, fit, held, seed=args.seed, progress=_say)
            print(f"\n{args.machine}: {time.perf_counter() - started:.0f} s", flush=True)
            print(findings_table(found))
            rival = rival_of(args.rival, model, fit, args.seed)
            print(errors_table(found, model, held, known, rival))
            if args.out:
                write(found, args.out)
            for name in known.elsewhere:
                log = machine.read(args.recordings, name)
                print(transfer_line(found, rival, log, known, model))
    except (UserError, WorkError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, UserError) else 1
    return 0


def planted(found: Diagnosis) -> tuple[Planted, ...]:
    """The named findings as a hypothesis; unknown ones have no parameters and are left out.

    Of what is fitted and not reported, as a gear's share of losses, the middle of its range.
    """
    known = effects()
    return tuple(
        Planted(
            known[f.effect],
            f.at,
            np.concatenate([_value(f, p) for p in known[f.effect].parameters]),
        )
        for f in found.findings
        if f.effect != "unknown"
    )


def _value(finding: Finding, parameter: Parameter) -> Array:
    if not parameter.public:
        return np.array([0.5 * (parameter.lower + parameter.upper)])
    return np.atleast_1d(finding.parameters[parameter.name].value)


def published(known: Known) -> tuple[Planted, ...]:
    """What is published for a machine, as a hypothesis."""
    all_of_them = effects()
    return tuple(
        Planted(all_of_them[name], Location(all_of_them[name].kind, joint), np.array([theta]))
        for name, joint, theta in known.published
    )


def findings_table(found: Diagnosis) -> str:
    """Verdict, and each finding with its parameters, intervals and worth."""
    lines = [f"verdict: {found.verdict}"]
    for f in found.findings:
        lines.append(
            f"  {f.effect} at {f.at}: share {f.holdout_gain:.2f}, p {f.p_value:.1e}"
            + "".join(f" ~ {c.effect} at {c.at}" for c in f.confusable_with)
        )
        for name, e in f.parameters.items():
            lines.append(
                f"      {name} = {_figures(e.value)} {e.unit}, 95 % "
                f"[{_figures(e.ci95[0])}, {_figures(e.ci95[1])}] {e.warning}".rstrip()
            )
        if f.formula:
            lines.append(f"      depends on {', '.join(f.depends_on)}: {f.formula}")
    lines += [f"  note: {note}" for note in found.notes]
    return "\n".join(lines)


def rival_of(name: str | None, model: Path, fit: Sequence[Recording], seed: int) -> Fitted | None:
    """What a rival makes of the fitted recordings; None if none is asked for."""
    if name is None:
        return None
    rival = Rival(model, fit)
    _say(f"fitting every parameter with mujoco.{name}", 1.0)
    fitted = rival.fit(every_parameter(rival.scene), seed)
    print(f"\nmujoco.{name}, {fitted.jacobian.shape[1]} parameters: {fitted.seconds:.0f} s")
    for (effect, place), theta in fitted.theta.items():
        print(f"  {effect} at {place}: {_figures(theta)}")
    return fitted


def errors_table(
    found: Diagnosis, model: Path, held: Sequence[Recording], known: Known, rival: Fitted | None
) -> str:
    """Held-out RMSE per joint, all by the same replays.

    What was found is replayed as proven where long stretches are, and by what was named where the
    proof's windows may be others. The last column is its error over the published parameters'.
    """
    scene = Scene(model)
    kept = prepared_holdout(scene, held)
    some = [(), published(known), *([rival.hypothesis] if rival else []), planted(found)]
    squares = np.nanmean(errors(kept, some, STEP_S) ** 2, axis=1)
    rmse = dict(zip(scene.joints, np.sqrt(squares).T, strict=True))
    what = "long stretches" if kept.forgets else "restarted every 0.5 s"
    beside = f"{'published':>11}" + (f"{'sysid':>11}" if rival else "")
    lines = [
        f"\nheld out, {what}; {known.reference!r} beside it",
        f"{'RMSE':<16}{'model':>10}{beside}{'findings':>10}{'noise':>10}{'ratio':>8}",
    ]
    rows = []
    for name, e in found.proof.joints.items():
        *others, named = rmse[name]
        rows.append((name, np.array([*others, e.after if kept.forgets else named, e.noise_floor])))
    rows.append(("mean", np.mean([row for name, row in rows if name in known.joints], axis=0)))
    for name, (before, *theirs, after, noise) in rows:
        lines.append(
            f"{name:<16}{before:>10.4f}{''.join(f'{x:>11.4f}' for x in theirs)}{after:>10.4f}"
            f"{noise:>10.5f}{after / theirs[0]:>8.2f}"
        )
    for unit, ahead in found.proof.horizons.items():
        for horizon, (before, after) in ahead.items():
            lines.append(f"  {horizon:>5.2f} s ahead: {before:.4f} → {after:.4f} {unit}")
    return "\n".join(lines)


def prepared_holdout(scene: Scene, recordings: Sequence[Recording]) -> Holdout:
    """Recordings ready for replays as the proof does them."""
    from wt.diagnose.recordings.stretches import forgets

    smoothed = smooth(scene, unsplit(scene, recordings))
    return prepare_holdout(smoothed, forgets(smoothed, STEP_S))


def transfer_line(
    found: Diagnosis, rival: Fitted | None, recording: Recording, known: Known, model: Path
) -> str:
    """Mean absolute errors on a set-up of its own model, to which nothing was fitted."""
    path = model.with_name(f"{Path(recording.meta['source']).stem}.xml")
    write_mjcf(spec_for(recording.meta), path)
    scene = Scene(path)
    kept = prepared_holdout(scene, [recording])
    some = {"": (), "published": published(known), "findings": planted(found)}
    some |= {"sysid": rival.hypothesis} if rival else {}
    mae = np.nanmean(np.abs(errors(kept, list(some.values()), STEP_S)), axis=(1, 2))
    said = ", ".join(f"{who} {e:.4f}".strip() for who, e in zip(some, mae, strict=True))
    return f"{recording.meta['source']:<28} MAE {said} rad"


def _figures(value: float | tuple[float, ...] | Array) -> str:
    return " ".join(f"{x:.4g}" for x in np.atleast_1d(value))


def _say(what: str, share: float) -> None:
    print(f"  {share:4.0%} {what}", file=sys.stderr, flush=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--machine", required=True, choices=KNOWN)
    parser.add_argument("--fit", nargs="+", help="motions to fit")
    parser.add_argument("--holdout", nargs="+", help="motions to hold out")
    parser.add_argument("--seconds", type=float, help="of each recording")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="their folder")
    parser.add_argument("--out", type=Path, help="folder for the reports")
    parser.add_argument("--rival", choices=["sysid"], help="what to compare with beside")
    return parser.parse_args(argv)


if __name__ == "__main__":
    raise SystemExit(main())
