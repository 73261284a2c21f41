"""Reports of the robot besides its joints' motion, as evidence: forces, and further sensors.

A measured actuator force splits the missing force in two: what the drive gives beyond the model's
law, and what the motion demands beyond what the drive gives. Where the first is large the fault is
in front of the measurement, where the second is, behind it. Neither changes the verdict.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from wt.diagnose.evidence import Measured, MeasuredForce, Side
from wt.diagnose.observed.sensors import sensed
from wt.diagnose.recordings.prepare import Prepared
from wt.diagnose.recordings.samples import Part, stamps
from wt.diagnose.residual.screen import Screen, leftover
from wt.diagnose.selection.holdout import Holdout
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.motion import Motion
from wt.physics.planted import Hypothesis
from wt.physics.scene import Drive
from wt.physics.units import unit_at
from wt.types import Location

_LEAST_ROWS = 50


def measured(
    prepared: Prepared,
    screen: Screen,
    holdout: Holdout,
    hypothesis: Hypothesis,
    step: float,
    mismatch: bool = True,
) -> Measured:
    """Compare what was measured besides the joints with model and replays.

    Args:
        prepared: the recordings.
        screen: the force residual of the fitted ones.
        holdout: the held-out ones.
        hypothesis: the findings.
        step: physics step of replays [s].
        mismatch: whether anything is missing; where replays say that nothing is, no force is, and
            what a robot's feet supply is no force that is missing.
    """
    forces = _forces(prepared.fit, screen, mismatch)
    sensors, left_out = sensed(prepared.held, holdout, hypothesis, step)
    notes = [note for note in map(sentence, forces) if note]
    if left_out:
        names = ", ".join(left_out)
        notes.append(f"Not compared, since the joints' motion alone does not decide it: {names}.")
    return Measured(forces, sensors, tuple(notes))


def sentence(force: MeasuredForce) -> str:
    """A measured force in a sentence; "" where nothing is missing."""
    law, motion = (f"{x:.2g} {force.unit}" for x in (force.off_law, force.off_motion))
    who = f"The measured force of actuator {force.actuator}"
    where = f"what is missing at joint {force.joint} lies"
    if force.side == "drive":
        return (
            f"{who} is {law} (RMS) off the model's and within {motion} of what the motion "
            f"demands: {where} in the drive, or in the position that the drive works with."
        )
    if force.side == "behind":
        return (
            f"{who} is within {law} (RMS) of the model's and {motion} off what the motion "
            f"demands: {where} behind the drive, in the joint or in what it moves."
        )
    if force.side == "both":
        return (
            f"{who} is {law} (RMS) off the model's and {motion} off what the motion demands: "
            f"{where} in the drive as well as behind it, or the force is measured wrongly."
        )
    if force.side == "measurement":
        return (
            f"{who} is {law} (RMS) off the model's, which is what the motion demands: check its "
            "unit, sign and scale."
        )
    return ""


def _forces(parts: Sequence[Part], screen: Screen, mismatch: bool) -> tuple[MeasuredForce, ...]:
    motion = screen.motion
    compared = []
    left = leftover(screen, ()).left
    for drive in motion.scene.drives:
        force = drive.gear * _on_grid(parts, motion, f"force/{drive.name}")
        known = np.isfinite(screen.weak(force)) & screen.keep[:, drive.dof].astype(bool)
        if known.sum() >= _LEAST_ROWS:
            missing = left if mismatch else np.zeros_like(left)
            compared.append(_compared(screen, drive, force, known, missing))
    return tuple(compared)


def _on_grid(parts: Sequence[Part], motion: Motion, name: str) -> Float[np.ndarray, " sample"]:
    """A column of recordings at the samples of their smooth motion; NaN where missing."""
    values = np.full(len(motion), np.nan)
    for part in parts:
        column = part.recording.columns.get(name)
        if column is None:
            continue
        clock, fine = stamps(part.recording), np.isfinite(column)
        for s in motion.segments:
            if s.recording == part.index and fine.any():
                t = motion.t[s.rows]
                near = clock[fine][np.clip(np.searchsorted(clock[fine], t), 0, fine.sum() - 1)]
                piece = np.interp(t, clock[fine], column[fine], left=np.nan, right=np.nan)
                # what lies in a gap of the column is not known
                values[s.rows] = np.where(np.abs(near - t) < 3.0 * s.dt, piece, np.nan)
    return values


def _compared(
    screen: Screen,
    drive: Drive,
    force: Float[np.ndarray, " sample"],
    known: Bool[np.ndarray, " row"],
    left: Float[np.ndarray, "row dof"],
) -> MeasuredForce:
    """One measured force on its joint, in the weak rows in which it is known."""
    motion, dof = screen.motion, drive.dof
    off = force - motion.force(drive)
    off_law, lacking = screen.weak(off), np.where(known, screen.residual[:, dof], np.nan)
    off_law -= _read(screen, drive, np.where(known, off_law, np.nan), lacking - off_law)
    scatter = off[1:-1] - 0.5 * (off[2:] + off[:-2])
    noise = 1.4826 * float(np.nanmedian(np.abs(scatter))) / np.sqrt(1.5) * _averaging(screen)
    sizes = [_rms(x[known]) for x in (off_law, lacking - off_law, lacking)]
    floor = THRESHOLDS.measured_noise * float(screen.floor[dof])
    allowed = [
        THRESHOLDS.measured_noise * noise
        + THRESHOLDS.measured_law * _rms(screen.weak(motion.force(drive))[known]),
        floor + THRESHOLDS.measured_demand * _rms(screen.weak(motion.demand[:, dof])[known]),
    ]
    missing = _rms(left[known, dof]) > floor
    scene, m = motion.scene, motion.scene.model
    return MeasuredForce(
        actuator=drive.name,
        joint=drive.joint,
        moves=tuple(b for b in scene.moving if scene.carries(m.body(b).id)[dof]),
        off_law=sizes[0],
        off_motion=sizes[1],
        lacking=sizes[2],
        unit=unit_at(scene, Location("joint", drive.joint), "N·m"),
        side=_side(sizes, allowed, missing),
    )


def _read(
    screen: Screen,
    drive: Drive,
    off_law: Float[np.ndarray, " row"],
    off_motion: Float[np.ndarray, " row"],
) -> Float[np.ndarray, " row"]:
    """Force that the moment of reading adds to a measured one, in weak rows.

    A sample is read before its command acts, or after, or is an average: half an interval early
    to half an interval late. The moment is taken at which the force agrees best with the model's
    law, or with the motion, whichever it agrees with better.

    Args:
        screen: the recordings.
        drive: the drive whose force was measured.
        off_law: measured force less the law; NaN where not measured.
        off_motion: force that the motion demands less the measured one; likewise.
    """
    half = 0.5 * screen.motion.dt
    early, late = (
        screen.motion.force(drive, screen.motion.delayed(drive.index, delay))
        for delay in (-half, half)
    )
    change, known = screen.weak(early - late), np.isfinite(off_law)
    size = max(float(change[known] @ change[known]), 1e-12)
    options = []
    for off in (off_law, -off_motion):
        share = float(np.clip(off[known] @ change[known] / size, -0.5, 0.5))
        options.append((_rms(off[known] - share * change[known]), share))
    return np.asarray(min(options)[1] * change)


def _side(sizes: Sequence[float], allowed: Sequence[float], missing: bool) -> Side:
    """The side of a measured force on which something is missing.

    Args:
        sizes: measured less law, demanded less measured, demanded less law.
        allowed: largest values of the first two that mean nothing.
        missing: whether the third is beyond the model tolerances.
    """
    off_law, off_motion = (x > most for x, most in zip(sizes[:2], allowed, strict=True))
    little = [x < THRESHOLDS.measured_small * max(sizes) for x in sizes]
    both = off_law and off_motion
    if both and little[2]:
        return "measurement"
    if not missing or not (off_law or off_motion):
        return "neither"
    if not both:
        return "drive" if off_law else "behind"
    if little[1]:
        return "drive"
    return "behind" if little[0] else "both"


def _averaging(screen: Screen) -> float:
    """Standard deviation of white noise of one in the weak form."""
    white = np.random.default_rng(0).standard_normal(len(screen.motion))
    return float(np.std(screen.weak(white)))


def _rms(values: Float[np.ndarray, " row"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
