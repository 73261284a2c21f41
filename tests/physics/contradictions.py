"""For every effect that a recording can rule out: what the arm's motion rules out, and what not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from wt.physics.motion import Motion
from wt.types import Location

Array = np.ndarray
JOINT, PAIR, DRIVE = Location("joint", "j1"), Location("pair", "j1+j2"), Location("actuator", "m1")


@dataclass(frozen=True)
class Contradiction:
    """An effect at a place with parameters that a motion rules out, and others that it does not."""

    at: Location
    impossible: Callable[[Motion], list[float]]
    possible: Callable[[Motion], list[float]]


def _q(motion: Motion) -> Array:
    return motion.q[:, motion.scene.dof(JOINT.name)]


def _both(motion: Motion) -> Array:
    return np.asarray(sum(motion.q[:, motion.scene.dof(name)] for name in PAIR.name.split("+")))


def _force(motion: Motion) -> Array:
    return np.abs(motion.force(motion.scene.drive(DRIVE.name)))


CONTRADICTIONS: Mapping[str, Contradiction] = {
    # hardly moved compared with how far its rest is away, a spring is a constant force
    "joint.stiffness": Contradiction(
        JOINT,
        lambda m: [1.0, float(_q(m).mean() + 30.0 * np.ptp(_q(m)))],
        lambda m: [1.0, float(_q(m).mean() + 3.0 * np.ptp(_q(m)))],
    ),
    "pair.spring": Contradiction(
        PAIR,
        lambda m: [1.0, 1.0, float(_both(m).mean() - 30.0 * np.ptp(_both(m)))],
        lambda m: [1.0, 1.0, float(_both(m).mean() - 3.0 * np.ptp(_both(m)))],
    ),
    # the joint goes on to where it turned round of itself
    "joint.stop": Contradiction(
        JOINT,
        lambda m: [float(np.median(_q(m))), 1.0],
        lambda m: [float(_q(m).max()) - 1e-3, 1.0],
    ),
    # what rubs at one place alone rubs nowhere else
    "joint.friction_position": Contradiction(
        JOINT,
        lambda m: [1.0, 1.0, 0.5 * float(np.ptp(_q(m))), 0.0],
        lambda m: [1.0, 0.8, 0.5 * float(np.ptp(_q(m))), 0.0],
    ),
    "joint.backlash": Contradiction(
        JOINT,
        lambda m: [1.1 * float(np.ptp(_q(m))), 0.0],
        lambda m: [0.5 * float(np.ptp(_q(m))), 0.0],
    ),
    "actuator.saturation": Contradiction(
        DRIVE,
        lambda m: [0.3 * float(np.abs(m.demand[:, m.scene.dof(JOINT.name)]).max())],
        lambda m: [0.9 * float(np.abs(m.demand[:, m.scene.dof(JOINT.name)]).max())],
    ),
    "actuator.deadband": Contradiction(
        DRIVE, lambda m: [1.1 * float(_force(m).max())], lambda m: [0.3 * float(_force(m).max())]
    ),
}
