"""Step sizes in proportion to a machine's own forces and motion.

An effect states the smallest change of a parameter that matters for a joint as strong as an arm's
(:data:`FORCE`, :data:`SPEED`, :data:`ACCELERATION`). What a pendulum of some grams can show is far
smaller: there the steps, and with them the narrowest interval, shrink in proportion.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.types import Location

FORCE, SPEED, ACCELERATION = 10.0, 1.0, 10.0
"""Generalised force [N·m], speed [rad/s] and acceleration [rad/s²] that steps are stated for."""
_POWERS = {
    "N·m": (1, 0, 0),
    "N": (1, 0, 0),
    "N/m": (1, 0, 0),
    "N·m/rad": (1, 0, 0),
    "N·m·s/rad": (1, -1, 0),
    "N·m·s²/rad²": (1, -2, 0),
    "N·s²/m²": (1, -2, 0),
    "kg·m²": (1, 0, -1),
    "kg": (1, 0, -1),
}
"""Unit → powers of force, speed and acceleration in it; angles and lengths are not scaled."""


def step_sizes(planted: Planted, motion: Motion) -> Float[np.ndarray, " theta"]:
    """Smallest changes that matter of an effect's parameters on the machine of a motion."""
    force, speed, acceleration = _usual(motion, planted.at)
    sizes = []
    for p in planted.effect.parameters:
        f, v, a = _POWERS.get(p.unit, (0, 0, 0))
        ratio = force**f * speed**v * acceleration**a
        sizes += [p.step * min(1.0, ratio)] * p.size
    return np.array(sizes)


def _usual(motion: Motion, at: Location) -> tuple[float, float, float]:
    """RMS force, speed and acceleration where a place acts, in those that steps are stated for."""
    scene = motion.scene
    dofs: slice | list[int] = slice(None)
    if at.kind == "joint":
        dofs = slice(scene.dof(at.name), scene.dof(at.name) + 1)
    elif at.kind == "actuator":
        dofs = [drive.dof for drive in scene.driven(at)]
    signals = ((motion.demand, FORCE), (motion.v, SPEED), (motion.a, ACCELERATION))
    force, speed, acceleration = (
        max(float(np.sqrt(np.mean(x[:, dofs] ** 2))) / usual, 1e-12) for x, usual in signals
    )
    return force, speed, acceleration
