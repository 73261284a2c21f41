"""What any rig is off by: small errors of masses, damping, gains and timing that are no finding.

A model made of a data sheet is never exact. Each of these errors is known in size, not in value;
hypotheses are compared with all of them free inside their box, so that what a few per cent of
mass explains is never blamed on missing physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import Effect, effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

Array = np.ndarray

_MASS, _DAMPING, _GAIN, _DELAY, _ARMATURE, _CLOCK = 0.02, 0.10, 0.01, 4e-4, 0.03, 1e-3
_LATE = ("actuator.delay", "sensor.delay")


@dataclass(frozen=True, eq=False)
class Nuisance:
    """One small error of unknown sign.

    Attributes:
        planted: the effect that expresses it, one standard deviation large; of one parameter.
        lowest: smallest ``theta`` that a model can hold.
    """

    planted: Planted
    lowest: float = -np.inf

    @property
    def neutral(self) -> float:
        """Its parameter when there is no error."""
        return _neutral(self.planted.effect)

    def scaled(self, size: float) -> Planted:
        """The effect of an error of ``size`` standard deviations."""
        theta = self.neutral + size * (self.planted.theta - self.neutral)
        return Planted(self.planted.effect, self.planted.at, np.maximum(theta, self.lowest))

    @property
    def correctable(self) -> bool:
        """Whether a model can be corrected by it: nothing can come early."""
        return self.planted.effect.id not in _LATE


def nuisances(scene: Scene) -> tuple[Nuisance, ...]:
    """The errors that any model of this machine may have."""
    m = scene.model
    known = effects()
    found: list[Nuisance] = []

    def add(effect: str, at: Location, size: float, lowest: float = -np.inf) -> None:
        theta = np.array([_neutral(known[effect]) + size])
        found.append(Nuisance(Planted(known[effect], at, theta), lowest))

    for body in scene.moving:
        add("body.mass", Location("body", body), _MASS)
    for joint in scene.own_joints:
        dof = scene.dof(joint)
        if m.dof_damping[dof] > 0.0:
            at = Location("joint", joint)
            add("joint.friction_viscous", at, _DAMPING * float(m.dof_damping[dof]))
        # half the rotor's inertia is rarely published; a share of the whole is what is unsure
        share, own = _ARMATURE * float(m.dof_M0[dof]), float(m.dof_armature[dof])
        add("joint.armature", Location("joint", joint), share, -own)
    if scene.free:
        # encoders and what tracks the base are two systems with two clocks
        add("sensor.delay", Location("sensor", "all"), _CLOCK)
    for drive in scene.drives:
        at = Location("actuator", drive.name)
        add("actuator.gain", at, _GAIN)
        add("actuator.delay", at, _DELAY)
    return tuple(found)


def boxes(some: Sequence[Nuisance], hypothesis: Sequence[Planted]) -> Array:
    """Largest error of each beside a hypothesis, (n,) [deviations]: 0 where that settles it."""
    settled = {(name, p.at) for p in hypothesis for name in p.effect.settles}
    beside = [(n.planted.effect.id, n.planted.at) not in settled for n in some]
    return THRESHOLDS.tolerance_box * np.array(beside, dtype=float)


def _neutral(effect: Effect) -> float:
    (parameter,) = effect.parameters
    assert parameter.neutral is not None
    return parameter.neutral


def forces(motion: Motion, some: Sequence[Nuisance]) -> list[Array]:
    """Generalised force of each error, one standard deviation large, (T, nv) each [N·m]."""
    columns = []
    for n in some:
        effect, at = n.planted.effect, n.planted.at
        size = float(n.planted.theta[0] - n.neutral)
        if effect.id in _LATE:
            # a delay of its own is the shape, with coefficient one
            columns.append(effect.columns(motion, at, (size,))[:, :, 0])
        else:
            columns.append(size * effect.columns(motion, at, ())[:, :, 0])
    return columns
