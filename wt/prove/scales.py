"""Torque, speed and travel of a rig's ordinary motions, by which effects are scaled."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wt.prove import legged_motions
from wt.prove.controllers import positions
from wt.prove.hidden import Plant
from wt.prove.legged_rigs import Legged
from wt.prove.motions import reference
from wt.prove.rigs import RIGS, Rig
from wt.prove.trajectory import HiddenTrajectory

_ON_LEGS = {
    "quadruped": {"multisine": "sway", "triangle": "twist", "jumps": "trot", "moves": "squat"},
    "humanoid": {"multisine": "sway", "triangle": "twist", "jumps": "swing", "moves": "squat"},
}
"""Motions of robots on legs that stand for an arm's."""


@dataclass(frozen=True)
class RigScales:
    """Scales of the joints.

    Attributes:
        torque: rms torque of the drive [N·m].
        hold: torque exceeded 5 % of the time in slow motion [N·m].
        peak: torque exceeded 1 % of the time in jumps [N·m].
        speed: rms speed [rad/s].
        dash: speed exceeded 1 % of the time in jumps [rad/s].
        acceleration: rms acceleration in multisine [rad/s²].
        low: position exceeded 90 % of the time in moves [rad].
        high: position exceeded 10 % of the time [rad].
        inertia: about each joint [kg·m²].
    """

    torque: Float[np.ndarray, " joint"]
    hold: Float[np.ndarray, " joint"]
    peak: Float[np.ndarray, " joint"]
    speed: Float[np.ndarray, " joint"]
    dash: Float[np.ndarray, " joint"]
    acceleration: Float[np.ndarray, " joint"]
    low: Float[np.ndarray, " joint"]
    high: Float[np.ndarray, " joint"]
    inertia: Float[np.ndarray, " joint"]


@functools.lru_cache
def scales(name: str) -> RigScales:
    """Measured on the rig with nothing hidden, as position servos."""
    rig = RIGS[name.removesuffix("_motor")]
    plant = Plant(rig, [], 1.0, np.ones((2, len(rig.links))), step=0.001)
    traces = _on_legs(rig, plant) if isinstance(rig, Legged) else _in_air(rig, plant)
    usual = [traces["multisine"], traces["moves"]]
    tau = np.concatenate([trace.fine_tau for trace in usual])
    v = np.concatenate([trace.fine_v for trace in usual])
    wave, q = traces["multisine"].fine_v, traces["moves"].fine_q
    inertia = np.array([plant.inertia(i) for i in range(len(rig.links))])
    acceleration = np.sqrt(((np.diff(wave, axis=0) / plant.h) ** 2).mean(axis=0))
    driven = np.array([link.driven for link in rig.links])

    def drives(torque: Float[np.ndarray, " joint"]) -> Float[np.ndarray, " joint"]:
        # nothing drives a passive joint: what counts there is what swings it
        return np.where(driven, torque, inertia * acceleration)

    return RigScales(
        torque=drives(np.sqrt((tau**2).mean(axis=0))),
        hold=drives(np.quantile(np.abs(traces["triangle"].fine_tau), 0.95, axis=0)),
        peak=drives(np.quantile(np.abs(traces["jumps"].fine_tau), 0.99, axis=0)),
        speed=np.sqrt((v**2).mean(axis=0)),
        dash=np.quantile(np.abs(traces["jumps"].fine_v), 0.99, axis=0),
        acceleration=acceleration,
        low=np.quantile(q, 0.1, axis=0),
        high=np.quantile(q, 0.9, axis=0),
        inertia=inertia,
    )


def _in_air(rig: Rig, plant: Plant) -> dict[str, HiddenTrajectory]:
    middle = np.array([link.middle for link in rig.links])
    amplitude = np.array([link.amplitude for link in rig.links])
    t = np.arange(0, 8, 0.01)
    traces = {}
    for seed, kind in enumerate(("multisine", "triangle", "jumps", "moves")):
        rng = np.random.default_rng(seed)
        path = reference(kind, t, middle, amplitude, rig.tempo, rng)
        start = np.array(rig.hanging(path[0]))
        traces[kind] = plant.run(start, np.arange(len(t)) * 10, positions(path), 500)
    return traces


def _on_legs(rig: Legged, plant: Plant) -> dict[str, HiddenTrajectory]:
    """The motions that come closest; none falls on a rig with nothing hidden."""
    t = np.arange(0, 8, 0.01)
    traces = {}
    for seed, (kind, motion) in enumerate(_ON_LEGS[rig.name].items()):
        path = legged_motions.reference(rig, motion, t, 0.8, np.random.default_rng(seed))
        traces[kind] = plant.run(path[0], np.arange(len(t)) * 10, positions(path), 500)
    return traces
