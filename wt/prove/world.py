"""``build(case)``: what a user of the hidden robot would have, MJCF and recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from wt.prove import body_laws, drive_laws, joint_laws
from wt.prove.cases import Case
from wt.prove.hidden import Law, Plant, Trace
from wt.prove.motions import reference
from wt.prove.rigs import RIGS, Rig, nominal_xml
from wt.prove.sensing import SensorEffect, measure, sample_steps, stamps
from wt.types import Recording

Array = np.ndarray
LAWS: dict[str, type[Law]] = drive_laws.LAWS | joint_laws.LAWS | body_laws.LAWS
LEAD_S = 1.5  # the robot settles under the first command


@dataclass(frozen=True)
class World:
    """One trial, ready to be diagnosed.

    Attributes:
        nominal_xml: the MJCF that the user believes in.
        fit: recordings to diagnose from.
        holdout: recordings to prove on.
        noise_rms: joint → rms error of recorded positions from noise and quantization [rad]. Time
            stamps that err are not in it, nor are hidden sensor effects other than quantization.
        clean: for each recording, fit then held out: joint → true positions at its rows [rad].
    """

    nominal_xml: str
    fit: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    noise_rms: Mapping[str, float]
    clean: tuple[Mapping[str, Array], ...]


def build(case: Case) -> World:
    """Simulate a case; the same for the same case."""
    rig = RIGS[case.rig]
    plant = hidden_plant(case)
    recordings, clean, errors = [], [], []
    for index in range(len(case.motions)):
        rng = np.random.default_rng([case.seed, 1, index])
        trace, steps = record(case, plant, index)
        columns, error = measure(rig, case.sensing, trace, steps, sensor_effects(case), rng)
        meta = {"robot": rig.name, "source": "concealed trial", "motion": case.motions[index]}
        t = stamps(case.sensing, steps, plant.h, rng)
        recordings.append(Recording(t, columns, meta))
        clean.append({joint: trace.q[:, i].copy() for i, joint in enumerate(rig.joints)})
        errors.append(error)
    rms = np.sqrt((np.concatenate(errors) ** 2).mean(axis=0))
    return World(
        nominal_xml=nominal_xml(rig, case.step, case.gain, case.sensing.gyro),
        fit=tuple(recordings[:-1]),
        holdout=tuple(recordings[-1:]),
        noise_rms={joint: float(rms[i]) for i, joint in enumerate(rig.joints)},
        clean=tuple(clean),
    )


def hidden_plant(case: Case, bare: bool = False) -> Plant:
    """The hidden world of a case, or the same robot with nothing but its few per cent (bare)."""
    rig = RIGS[case.rig]
    laws: list[Law] = []
    for truth in () if bare else case.truth:
        if truth.law in LAWS:  # sensors are not in the world
            rng = np.random.default_rng([case.seed, 2, len(laws)])
            laws.append(LAWS[truth.law](truth.name, truth.parameters, rng))
    rng = np.random.default_rng([case.seed, 3])
    shape = (2, len(rig.links))
    off = 1.0 + rng.choice([-1.0, 1.0], shape) * rng.uniform(0.01, 0.03, shape)
    return Plant(rig, laws, case.gain, off)


def sensor_effects(case: Case) -> list[SensorEffect]:
    """What is wrong with the sensors of a case."""
    return [
        (truth.law, truth.name, truth.parameters)
        for truth in case.truth
        if truth.law.startswith("sensor.")
    ]


def record(case: Case, plant: Plant, index: int) -> tuple[Trace, Array]:
    """Run one recording; what happened, and at which steps the loop sampled."""
    rig = plant.rig
    rng = np.random.default_rng([case.seed, 4, index])
    steps = sample_steps(case.sensing, case.seconds, plant.h, rng)
    path = _path(case, rig, case.motions[index], steps * plant.h, rng)
    controller = _motor_loop(rig, path, steps * plant.h) if rig.motor else _commands(path)
    trace = plant.run(path[0], steps, controller, round(LEAD_S / plant.h))
    return trace, steps


def _path(case: Case, rig: Rig, kind: str, t: Array, rng: np.random.Generator) -> Array:
    middle = np.array([link.middle for link in rig.links])
    amplitude = np.array([link.amplitude for link in rig.links])
    if case.decoy == "poor_excitation":
        lazy = np.random.default_rng([case.seed, 5]).integers(len(rig.links))
        amplitude[lazy] *= 0.02
    return reference(kind, t, middle, amplitude, rig.tempo, rng)


def _commands(path: Array) -> Callable[[int, Array, Array], Array]:
    return lambda row, q, v: path[row]


def _motor_loop(rig: Rig, path: Array, t: Array) -> Callable[[int, Array, Array], Array]:
    """A PD controller with gravity compensation outside the model: its torque is the command."""
    nominal = Plant(rig, [], 1.0, np.ones((2, len(rig.links))))
    # softer than the servos, since it acts at the sampling rate
    kp, kv = 0.4 * nominal.kp, 0.5 * nominal.kv
    hold = nominal.gravity_torques(path)
    speed = np.gradient(path, t, axis=0)
    limit = nominal.limit

    def control(row: int, q: Array, v: Array) -> Array:
        tau = kp * (path[row] - q) + kv * (np.clip(speed[row], -3, 3) - v) + hold[row]
        return np.clip(tau, -limit, limit)

    return control


def visibility(case: Case) -> float:
    """Rms change of recorded positions by what is hidden, over their noise.

    At the joint and in the fit recording where it is largest; sensor effects are counted too.
    """
    rig = RIGS[case.rig]
    plants = [hidden_plant(case, bare) for bare in (False, True)]
    sharp = replace(case.sensing, noise=0.0, bits=30, drops=0.0)
    change = 0.0
    for index in range(len(case.motions) - 1):
        seen, plain = (
            measure(rig, sharp, *record(case, plant, index), effects, np.random.default_rng(0))[0]
            for plant, effects in zip(plants, (sensor_effects(case), []), strict=True)
        )
        for joint in rig.joints:
            apart = seen[f"qpos/{joint}"] - plain[f"qpos/{joint}"]
            change = max(change, float((apart**2).mean()))
    return math.sqrt(change) / case.sensing.position_noise
