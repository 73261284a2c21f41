"""Losses of a gear, other ones while it is driven than while it drives.

Strain-wave and cycloid gears pass on most of what the motor gives them, and far less of what the
load gives back. While they slide, that is friction in proportion to the drive's force beside a
drive of another strength, which no motion of the joint tells from it.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import nnls

from wt.physics.driving import all_drives, force_of_all
from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._bristle import BRISTLE, BristleFriction, slip
from wt.physics.effects._tools import add_dry_friction, mean_weight
from wt.physics.hooks import Beyond, Intervals, Nested, Parts, Uniting
from wt.physics.live import Law, Values
from wt.physics.motion import Motion
from wt.physics.parts import compiled
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_APART = 0.1
"""Difference of the shares from which it is one. Half of it is what a drive of another strength
would do, and drives and weights are off by 2 % together, as a standard deviation."""
_SEEN = 0.05
"""Least share of a joint's motion in which it drives, and in which it is driven, to tell both."""


@Law
def _lossy(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    force = force_of_all(own, BRISTLE, q, v, u)
    always = theta[2] + theta[3] * abs(v[dof])
    # forward a positive force drives, and is driven backward
    ahead = always + max(theta[0] * force, -theta[1] * force)
    back = always + max(-theta[0] * force, theta[1] * force)
    return slip(ahead, back, v[dof], h, own)


@register
class GearLoss(Nested, Uniting, BristleFriction):
    """τ = −sign(v) · (coulomb + viscous · |v| + share · |drive force|).

    The share is ``drive`` where the drive's force has the sign of v, and ``back`` where it has not.
    """

    id = "joint.gear_loss"
    kind = "joint"
    law = _lossy
    parameters = (
        Parameter("drive", "-", 0.0, 1.0, 1e-3, neutral=0.0),
        Parameter("back", "-", 0.0, 100.0, 1e-3, neutral=0.0),
        Parameter("coulomb", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("viscous", "N·m·s/rad", 0.0, 1e8, 1e-4, neutral=0.0),
    )
    reference = (
        "MuJoCo issue 3528, Torque-proportional loss in dcmotor, 2026; M. Duclusaud et al., "
        "Extended friction models for servo actuators, ICRA 2025"
    )
    native = False
    excludes = ("joint.friction_coulomb", "joint.friction_viscous", "joint.friction_load")
    unites = excludes
    settles = ("joint.friction_viscous",)
    signed = (1, 1, 1, 1)
    looks_like = ("dry friction",)
    odds_against = 4.0
    plotted_over = "drive"
    each_way = True

    def needs(
        self, scene: Scene, dofs: Int[np.ndarray, " place"]
    ) -> Float[np.ndarray, "place figure"]:
        """All drives of each joint."""
        return all_drives(scene, dofs)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """None where the joint loses alike both ways, or only seems to: a drive that is off."""
        return [()] if self.plausible(motion, at, _read_off(motion, at)) else []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−sign(v)·|drive force| while driving and while driven, −sign(v), and −v."""
        return motion.on(motion.scene.dof(at.name), *_lost(motion, at).T)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The coefficients are the parameters."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Stand-in: ``frictionloss`` of both losses' mean under the mean weight, ``damping``."""
        load = mean_weight(compiled(spec), at.name)
        dry = theta[2] + 0.5 * (theta[0] + theta[1]) * load
        if dry > 0.0:
            add_dry_friction(spec, at.name, float(dry))
        spec.joint(at.name).damping[0] += theta[3]

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse what loses alike both ways, what gains one way, and what is seen one way only."""
        driving = _driving(motion, at)
        both = min(driving.mean(), 1.0 - driving.mean()) > _SEEN
        return bool(both and min(theta[:2]) > 0.0 and abs(theta[1] - theta[0]) > _APART)

    def beyond(
        self, motion: Motion, at: Location, law: str, theta: Float[np.ndarray, " smaller"]
    ) -> Sequence[Beyond]:
        """Friction by load, which loses alike both ways."""
        if law != "joint.friction_load":
            return []
        coulomb, fraction = theta
        return [((), np.array([fraction, fraction, coulomb, 0.0]))]

    def union(
        self, motion: Motion, at: Location, parts: Parts
    ) -> Float[np.ndarray, " parameter"] | None:
        """Friction by load beside other friction, as long as it loses alike both ways."""
        if ("joint.friction_load", at) not in parts:
            return None
        coulomb, fraction = parts["joint.friction_load", at]
        dry, wet = (
            float(parts.get((f"joint.friction_{kind}", at), np.zeros(1))[0])
            for kind in ("coulomb", "viscous")
        )
        return np.array([fraction, fraction, max(coulomb + dry, 0.0), max(wet, 0.0)])

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Friction by load, where both losses may be alike; what grows with speed is another's."""
        (low, high), (least, most) = intervals["drive"], intervals["back"]
        if max(np.min(low), np.min(least)) > min(np.max(high), np.max(most)):
            return None
        return "joint.friction_load", np.array([theta[2], 0.5 * (theta[0] + theta[1])])

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Friction by an elastic bristle that slips."""
        drive, back, coulomb, viscous = map(number, theta)
        level = (
            f'load = self._drives("{at.name}", qpos, qvel, ctrl)',
            f'always = {coulomb} + {viscous} * np.abs(qvel[:, self._joints["{at.name}"][1]])',
            f"level = always + np.maximum({drive} * load, -{back} * load)",
            f"back = always + np.maximum(-{drive} * load, {back} * load)",
        )
        return self.slipping(at, level, "drives", back="back")

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"The gear of joint {at.name} loses {100 * theta[0]:.3g} % of its drive's force while "
            f"it drives and {100 * theta[1]:.3g} % while it is driven, and {theta[2]:.3g} "
            f"{units.force} and {theta[3]:.3g} {units.of('N·m·s/rad')} of friction besides."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return (
            f"lifting and lowering several loads by {at.name} at constant speeds; a weak or strong "
            "drive beside friction by load is told from it by a measured force only"
        )


def _driving(motion: Motion, at: Location) -> np.ndarray:
    """Whether the drives of a joint have the sign of its velocity, (T,)."""
    dof = motion.scene.dof(at.name)
    return np.asarray(motion.drive_forces[:, dof] * motion.v[:, dof] > 0.0)


def _lost(motion: Motion, at: Location) -> Float[np.ndarray, "sample 4"]:
    """Force per unit of each parameter."""
    dof, driving = motion.scene.dof(at.name), _driving(motion, at)
    v = motion.v[:, dof]
    load = -np.sign(v) * np.abs(motion.drive_forces[:, dof])
    return np.stack([load * driving, load * ~driving, -np.sign(v), -v], axis=1)


def _read_off(motion: Motion, at: Location) -> Float[np.ndarray, " 4"]:
    """Parameters that take the most off the residual of a joint, whatever else is missing."""
    dof = motion.scene.dof(at.name)
    v, left = motion.v[:, dof], motion.unexplained[:, dof]
    rows = np.abs(v) > 0.1 * np.std(v)  # slower, it sticks as much as it slides
    columns = _lost(motion, at)[rows]
    return np.asarray(nnls(columns, left[rows])[0])
