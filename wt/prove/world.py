"""``build(case)``: what a user of the hidden robot would have, MJCF and recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wt.prove import body_laws, drive_laws, joint_laws
from wt.prove.cases import Case, Truth
from wt.prove.hidden import Law, Plant, Trace
from wt.prove.motions import reference
from wt.prove.rigs import RIGS, Rig, nominal_xml
from wt.prove.sensing import SensorEffect, measure, sample_steps, stamps
from wt.types import Recording

Array = np.ndarray
LAWS: dict[str, type[Law]] = drive_laws.LAWS | joint_laws.LAWS | body_laws.LAWS
LEAD_S = 1.5  # the robot settles under the first command
_OUTER_KP = 0.4
"""Stiffness of the controller outside the model, as a share of the servo's."""


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


def hidden_plant(case: Case, hidden: Sequence[Truth] | None = None) -> Plant:
    """The hidden world of a case, with all that is hidden in it or with a part of that."""
    rig = RIGS[case.rig]
    acting = [truth for truth in case.truth if truth.law in LAWS]  # sensors are not in the world
    laws = [
        LAWS[truth.law](truth.name, truth.parameters, np.random.default_rng([case.seed, 2, i]))
        for i, truth in enumerate(acting)
        if hidden is None or truth in hidden
    ]
    rng = np.random.default_rng([case.seed, 3])
    shape = (2, len(rig.links))
    off = 1.0 + rng.choice([-1.0, 1.0], shape) * rng.uniform(0.01, 0.03, shape)
    if case.decoy == "wrong_mass":
        wrong = rig.bodies.index(case.excused[0][2])
        off[0, wrong] = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.06, 0.1)
    return Plant(rig, laws, case.gain, off)


def sensor_effects(case: Case, hidden: Sequence[Truth] | None = None) -> list[SensorEffect]:
    """What is wrong with the sensors of a case, or a part of that."""
    return [
        (truth.law, truth.name, truth.parameters)
        for truth in case.truth
        if truth.law.startswith("sensor.") and (hidden is None or truth in hidden)
    ]


def record(case: Case, plant: Plant, index: int) -> tuple[Trace, Array]:
    """Run one recording; what happened, and at which steps the loop sampled."""
    rig = plant.rig
    rng = np.random.default_rng([case.seed, 4, index])
    steps = sample_steps(case.sensing, case.seconds, plant.h, rng)
    path = _path(case, rig, case.motions[index], steps * plant.h, rng)
    controller = _motor_loop(rig, path, steps * plant.h) if rig.motor else _commands(path)
    trace = plant.run(np.array(rig.hanging(path[0])), steps, controller, round(LEAD_S / plant.h))
    return trace, steps


def _path(case: Case, rig: Rig, kind: str, t: Array, rng: np.random.Generator) -> Array:
    middle = np.array([link.middle for link in rig.links])
    amplitude = np.array([link.amplitude for link in rig.links])
    if case.decoy == "poor_excitation":
        driven = [i for i, link in enumerate(rig.links) if link.driven]
        lazy = np.random.default_rng([case.seed, 5]).integers(len(driven))
        amplitude[driven[lazy]] *= 0.02
    return reference(kind, t, middle, amplitude, rig.tempo, rng)


def _commands(path: Array) -> Callable[[int, Array, Array], Array]:
    return lambda row, q, v: path[row]


def _motor_loop(rig: Rig, path: Array, t: Array) -> Callable[[int, Array, Array], Array]:
    """A PD controller with gravity compensation outside the model: its torque is the command."""
    nominal = Plant(rig, [], 1.0, np.ones((2, len(rig.links))))
    # softer than the servos, since it acts at the sampling rate
    kp, kv = _OUTER_KP * nominal.kp, 0.5 * nominal.kv
    hold = nominal.gravity_torques(path)
    speed = np.gradient(path, t, axis=0)
    limit = nominal.limit

    def control(row: int, q: Array, v: Array) -> Array:
        tau = kp * (path[row] - q) + kv * (np.clip(speed[row], -3, 3) - v) + hold[row]
        return np.clip(tau, -limit, limit)

    return control


def visibility(case: Case) -> float:
    """Rms change of recordings by what is hidden, over their noise; see :func:`visibilities`."""
    return _change(case, case.truth, ())


def visibilities(case: Case) -> tuple[float, ...]:
    """For each hidden effect the rms change that it makes in the recordings, over their noise.

    It is the change of positions at the joint and in the fit recording where it is largest, the
    other hidden effects acting in both worlds; sensor effects are counted too. The controller of
    a torque-controlled rig is outside the model and hides in its commands what a servo shows in
    positions: there, the change of its torque over its stiffness counts as well.
    """
    return tuple(
        _change(case, case.truth, tuple(other for other in case.truth if other is not truth))
        for truth in case.truth
    )


def _change(case: Case, some: Sequence[Truth], others: Sequence[Truth]) -> float:
    rig = RIGS[case.rig]
    sharp = replace(case.sensing, noise=0.0, bits=30, drops=0.0)
    stiffness = np.array([_OUTER_KP * link.kp for link in rig.links])
    change = 0.0
    for index in range(len(case.motions) - 1):
        seen, sent = [], []
        for hidden in (some, others):
            trace, steps = record(case, hidden_plant(case, hidden), index)
            found = measure(
                rig, sharp, trace, steps, sensor_effects(case, hidden), np.random.default_rng(0)
            )[0]
            seen.append(np.stack([found[f"qpos/{joint}"] for joint in rig.joints]))
            sent.append(trace.u.T)
        apart = ((seen[0] - seen[1]) ** 2).mean(axis=1)
        if rig.motor:
            apart = np.maximum(apart, (((sent[0] - sent[1]).T / stiffness) ** 2).mean(axis=0))
        change = max(change, float(apart.max()))
    return math.sqrt(change) / case.sensing.position_noise
