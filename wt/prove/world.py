"""``build(case)``: MJCF and recordings as a user of the hidden robot would have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from wt.errors import WorkError
from wt.prove import controllers, legged_motions
from wt.prove.base_sensing import measure_base
from wt.prove.case import Case, HiddenEffect
from wt.prove.hidden import Plant
from wt.prove.laws import LAWS as LAWS
from wt.prove.legged_rigs import Legged
from wt.prove.legged_world import CALM, tolerances, upright
from wt.prove.motions import reference
from wt.prove.rigs import RIGS, Rig, nominal_xml
from wt.prove.sensing import SensorEffect, measure, sample_steps, stamps
from wt.prove.trajectory import HiddenTrajectory
from wt.types import Recording

LEAD_S = 1.5  # the robot settles under the first command


class FallsError(WorkError):
    """The robot cannot even stand with the effects hidden in it."""


@dataclass(frozen=True)
class HiddenWorld:
    """One trial, ready to be diagnosed.

    Attributes:
        nominal_xml: the MJCF that the user believes in.
        fit: recordings to diagnose from.
        holdout: recordings to prove on.
        noise_rms: joint → rms error of recorded positions from noise and quantization [rad]. Time
            stamps that err are not in it, nor are hidden sensor effects other than quantization.
        clean: for each recording, fit then held out: joint → true positions at its rows [rad].
        calm: for each recording, the share of a motion's usual size that keeps the robot upright.
    """

    nominal_xml: str
    fit: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    noise_rms: Mapping[str, float]
    clean: tuple[Mapping[str, Float[np.ndarray, " _sample"]], ...]
    calm: tuple[float, ...] = ()


@dataclass(frozen=True)
class Observed:
    """One recording, and what it is of.

    Attributes:
        recording: as a user has it.
        trace: the true motion.
        error: of recorded positions, from noise and quantization [rad].
        size: share of the motion's usual size.
    """

    recording: Recording
    trace: HiddenTrajectory
    error: Float[np.ndarray, "sample joint"]
    size: float


def build(case: Case) -> HiddenWorld:
    """Simulate a case; the same for the same case."""
    rig = RIGS[case.rig]
    plant = hidden_plant(case)
    runs = [observe(case, plant, index) for index in range(len(case.motions))]
    rms = np.sqrt((np.concatenate([run.error for run in runs]) ** 2).mean(axis=0))
    return HiddenWorld(
        nominal_xml=nominal_xml(rig, case.step, case.gain, _reads_imu(case)),
        fit=tuple(run.recording for run in runs[:-1]),
        holdout=tuple(run.recording for run in runs[-1:]),
        noise_rms={joint: float(rms[i]) for i, joint in enumerate(rig.joints)},
        clean=tuple(
            {joint: run.trace.q[:, i].copy() for i, joint in enumerate(rig.joints)} for run in runs
        ),
        calm=tuple(run.size for run in runs),
    )


def observe(case: Case, plant: Plant, index: int) -> Observed:
    """Simulate one recording of a case, and measure it."""
    trace, steps, size = _steady(case, plant, index)
    rng = np.random.default_rng([case.seed, 1, index])
    recording, error = measured(case, plant, trace, steps, rng)
    meta = {**recording.meta, "motion": case.motions[index]}
    return Observed(replace(recording, meta=meta), trace, error, size)


def measured(
    case: Case,
    plant: Plant,
    trace: HiddenTrajectory,
    steps: Int[np.ndarray, " sample"],
    rng: np.random.Generator,
) -> tuple[Recording, Float[np.ndarray, "sample joint"]]:
    """The recording of a true motion, and the error of its positions [rad]."""
    rig = RIGS[case.rig]
    columns, error = measure(rig, case.sensing, trace, steps, sensor_effects(case), rng)
    if case.sensing.base is not None:
        columns |= measure_base(case.sensing.base, trace, case.sensing.qvel != "none", rng)
    t = stamps(case.sensing, steps, plant.h, rng)
    return Recording(t, columns, {"robot": rig.name, "source": "concealed trial"}), error


def _reads_imu(case: Case) -> bool:
    base = case.sensing.base
    return case.sensing.gyro or (base is not None and base.imu)


def _steady(
    case: Case, plant: Plant, index: int
) -> tuple[HiddenTrajectory, Int[np.ndarray, " sample"], float]:
    """Record a motion at the largest size at which the robot does not fall.

    Raises:
        FallsError: it cannot even stand.
    """
    for size in CALM:
        trace, steps = record(case, plant, index, size)
        if not isinstance(plant.rig, Legged) or upright(trace, plant.rig):
            return trace, steps, size
    raise FallsError(f"case '{case.name}': the robot falls whatever it does; choose another seed")


def hidden_plant(case: Case, hidden: Sequence[HiddenEffect] | None = None) -> Plant:
    """The hidden world of a case, with all of its effects or those among ``hidden``."""
    rig = RIGS[case.rig]
    acting = [truth for truth in case.truth if not truth.law.startswith("sensor.")]
    laws = [
        LAWS[truth.law](truth.name, truth.parameters, np.random.default_rng([case.seed, 2, i]))
        for i, truth in enumerate(acting)
        if hidden is None or truth in hidden
    ]
    rng = np.random.default_rng([case.seed, 3])
    shape = (2, len(rig.links))
    factors = 1.0 + rng.choice([-1.0, 1.0], shape) * rng.uniform(0.01, 0.03, shape)
    if case.decoy == "wrong_mass":
        wrong = rig.bodies.index(case.excused[0][2])
        factors[0, wrong] = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.06, 0.1)
    # tolerances come first, so that a hidden friction is the one that acts
    usual = tolerances(case, rig) if isinstance(rig, Legged) else []
    interval = 1.0 / case.sensing.rate
    return Plant(rig, [*usual, *laws], case.gain, factors, interval=interval)


def sensor_effects(case: Case, hidden: Sequence[HiddenEffect] | None = None) -> list[SensorEffect]:
    """The hidden sensor effects of a case, or those among ``hidden``."""
    return [
        (truth.law, truth.name, truth.parameters)
        for truth in case.truth
        if truth.law.startswith("sensor.") and (hidden is None or truth in hidden)
    ]


def record(
    case: Case, plant: Plant, index: int, calm: float = 1.0
) -> tuple[HiddenTrajectory, Int[np.ndarray, " sample"]]:
    """Run one recording; its trajectory, and the steps at which the loop sampled.

    Args:
        case: the trial.
        plant: its world.
        index: of the recording.
        calm: share of a motion's usual size.
    """
    rig = plant.rig
    path, steps = commands(case, plant, index, calm)
    if rig.motor:
        controller = controllers.torques(rig, path, steps * plant.h)
    else:
        controller = controllers.positions(path)
    trace = plant.run(np.array(rig.hanging(path[0])), steps, controller, round(LEAD_S / plant.h))
    return trace, steps


def commands(
    case: Case, plant: Plant, index: int, calm: float = 1.0
) -> tuple[Float[np.ndarray, "sample joint"], Int[np.ndarray, " sample"]]:
    """Positions commanded in a recording [rad], and the steps at which they are sent."""
    rng = np.random.default_rng([case.seed, 4, index])
    steps = sample_steps(case.sensing, case.seconds, plant.h, rng)
    return _path(case, plant.rig, case.motions[index], steps * plant.h, calm, rng), steps


def _path(
    case: Case,
    rig: Rig,
    kind: str,
    t: Float[np.ndarray, " sample"],
    calm: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"]:
    if isinstance(rig, Legged):
        return legged_motions.reference(rig, kind, t, calm, rng)
    middle = np.array([link.middle for link in rig.links])
    amplitude = np.array([link.amplitude for link in rig.links])
    if case.decoy == "poor_excitation":
        driven = [i for i, link in enumerate(rig.links) if link.driven]
        lazy = np.random.default_rng([case.seed, 5]).integers(len(driven))
        amplitude[driven[lazy]] *= 0.02
    return reference(kind, t, middle, amplitude, rig.tempo, rng)
