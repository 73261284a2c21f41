"""Friction that differs with the direction of motion, as of a preloaded screw or a seal.

A model that has some friction, of one size for both directions, may have too little of it one way
and too much the other. Nothing that is added to it says so: there the joint's whole friction is
found, in the place of the model's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._bristle import BristleFriction, brake
from wt.physics.effects._tools import add_dry_friction
from wt.physics.hooks import FromRecordings, Intervals, Nested
from wt.physics.live import Law, Values
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_APART = 0.1
"""Difference of the two directions, as a share of their friction, that is more than an error."""
_SLOW = 0.1
"""Share of the usual speed below which a joint sticks as much as it slides."""


@Law
def _directed(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    speed = v[dof]
    level = theta[0] + theta[2] * speed if speed > 0.0 else theta[1] - theta[3] * speed
    return brake(level, speed, h, own)


@register
class FrictionDirectional(FromRecordings, Nested, BristleFriction):
    """τ = −(coulomb_forward + viscous_forward · v) for v > 0, and the like backward for v < 0.

    The shape () adds it to the model's own friction. The shape of two figures, which are the dry
    and the viscous friction of the model, is :class:`_Whole`.
    """

    id = "joint.friction_directional"
    kind = "joint"
    law = _directed
    parameters = (
        Parameter("coulomb_forward", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("coulomb_backward", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("viscous_forward", "N·m·s/rad", 0.0, 1e8, 1e-4, neutral=0.0),
        Parameter("viscous_backward", "N·m·s/rad", 0.0, 1e8, 1e-4, neutral=0.0),
    )
    reference = (
        "B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, A survey of models, analysis "
        "tools and compensation methods for the control of machines with friction, Automatica "
        "30(7), 1994"
    )
    native = False
    signed = (1, 1, 1, 1)
    read_off = 2
    looks_like = ("dry friction",)
    odds_against = 4.0
    plotted_over = "velocity"

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """None where the joint is braked alike in both directions, or not braked."""
        braking, speed = _braking(motion, motion.scene.dof(at.name)), _speed(motion, at)
        if _apart(braking, speed):
            return [()]
        own = _own(motion.scene, at)
        return [own] if _astride(braking + np.repeat(own, 2), own, speed) else []

    def shaped(self, shape: Shape) -> Effect:
        """The whole friction of a joint, where the model has some of its own."""
        return _WHOLE if shape else self

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """∓1 and −v, of each direction."""
        dof = motion.scene.dof(at.name)
        return motion.on(dof, *_braked(motion.v[:, dof]).T)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficients are the parameters; what the model has comes on top for the whole."""
        return coefficients + np.repeat(shape, 2) if shape else coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Stand-in: ``frictionloss`` and ``damping`` of the mean of both directions."""
        self.cleared(spec, at)
        if np.any(theta[:2]):
            add_dry_friction(spec, at.name, float(np.mean(theta[:2])))
        spec.joint(at.name).damping[0] += np.mean(theta[2:])

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse what brakes both directions alike."""
        return _apart(theta, _speed(motion, at))

    def given(self, scene: Scene, at: Location) -> tuple[float, float]:
        """Dry and viscous friction of the model that is part of it [N·m, N·m·s/rad]: none."""
        return 0.0, 0.0

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Coulomb's, where both directions may be alike and none of it need grow with speed.

        That is as large as both are at a usual speed on average, less what the model has.
        """
        own, speed = np.array(self.given(motion.scene, at)), _speed(motion, at)
        (ahead, back), wet = (
            [intervals[f"{kind}_{way}"] for way in ("forward", "backward")]
            for kind in ("coulomb", "viscous")
        )
        alike = max(np.min(ahead[0]), np.min(back[0])) <= min(np.max(ahead[1]), np.max(back[1]))
        steady = all(np.min(low) <= own[1] <= np.max(high) for low, high in wet)
        dry = float((theta.reshape(2, 2).mean(axis=1) - own) @ (1.0, speed))
        both_ways = (theta.reshape(2, 2).T @ (1.0, speed)).min() > 0.0
        if not (alike and steady and both_ways) or dry <= 0.0:
            return None
        return "joint.friction_coulomb", np.array([dry])

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Friction by an elastic bristle that slips."""
        (forward, backward), (fast, slow) = (map(number, pair) for pair in np.split(theta, 2))
        level = (
            f'_, v, dof = self._joint("{at.name}", qpos, qvel)',
            f"level = np.where(v > 0.0, {forward} + {fast} * v, {backward} - {slow} * v)",
        )
        return self.slipping(at, level, "joint")

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Joint {at.name} has friction of {_both(theta, units)}, which the model leaves out."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"several constant speeds of {at.name}, each in both directions, and rests"


class _Whole(FrictionDirectional):
    """All friction that a joint has, in the place of the model's own."""

    signed = (0, 0, 0, 0)
    excludes = ("joint.friction_coulomb", "joint.friction_viscous")
    settles = ("joint.friction_viscous",)

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse what could be added to the model, or is its own, a little more or less of it."""
        return _astride(theta, _own(motion.scene, at), _speed(motion, at))

    def given(self, scene: Scene, at: Location) -> tuple[float, float]:
        """All that the model has."""
        return _own(scene, at)

    def cleared(self, spec: mujoco.MjSpec, at: Location) -> None:
        """Without ``frictionloss``, and without the linear part of ``damping``."""
        spec.joint(at.name).frictionloss = 0.0
        spec.joint(at.name).damping[0] = 0.0

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Joint {at.name} has friction of {_both(theta, units)} in all, where the model has "
            "the same both ways."
        )


_WHOLE = _Whole()


def _both(theta: Float[np.ndarray, " 4"], units: Units) -> str:
    """Friction forward and backward, in words."""
    forward, backward = (
        f"{dry:.3g} {units.force} and {wet:.3g} {units.of('N·m·s/rad')}"
        for dry, wet in zip(theta[:2], theta[2:], strict=True)
    )
    return f"{forward} forward and of {backward} backward"


def _own(scene: Scene, at: Location) -> tuple[float, float]:
    """Dry and viscous friction of a joint in the model [N·m, N·m·s/rad]."""
    m, dof = scene.model, scene.dof(at.name)
    return float(m.dof_frictionloss[dof]), float(np.ravel(m.dof_damping[dof])[0])


def _braked(v: Float[np.ndarray, " sample"]) -> Float[np.ndarray, "sample 4"]:
    """Force per unit of each parameter at some velocities."""
    ahead, back = (v > 0.0).astype(float), (v < 0.0).astype(float)
    return np.stack([-ahead, back, -v * ahead, -v * back], axis=1)


def _braking(motion: Motion, dof: int) -> Float[np.ndarray, " 4"]:
    """Parameters that the residual of a joint is best braked with, whatever else is missing."""
    v, left = motion.v[:, dof], motion.unexplained[:, dof]
    rows = np.abs(v) > _SLOW * np.std(v)
    coefficients, *_ = np.linalg.lstsq(_braked(v[rows]), left[rows], rcond=1e-6)
    return np.asarray(coefficients)


def _speed(motion: Motion, at: Location) -> float:
    """Usual speed of a joint [rad/s]."""
    return float(np.sqrt(np.mean(motion.v[:, motion.scene.dof(at.name)] ** 2)))


def _apart(theta: Float[np.ndarray, " 4"], speed: float) -> bool:
    """Tell whether both directions are braked, and not alike, at rest or at a usual speed."""
    dry, wet = theta[:2], speed * theta[2:]
    braking = dry + wet
    apart = max(abs(dry[0] - dry[1]), abs(wet[0] - wet[1]), abs(braking[0] - braking[1]))
    return bool(braking.min() > 0.0 and apart > _APART * braking.sum())


def _astride(theta: Float[np.ndarray, " 4"], own: tuple[float, float], speed: float) -> bool:
    """Tell whether a model brakes too much one way and too little the other, dry or by speed.

    By more than what is added to it, or an error of its friction both ways, could say.
    """
    if (theta[:2] + speed * theta[2:]).min() <= 0.0:
        return False
    parts = zip(np.split(theta, 2), own, strict=True)
    return any(min(x) < known < max(x) and np.ptp(x) > _APART * np.sum(x) for x, known in parts)
