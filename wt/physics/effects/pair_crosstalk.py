"""A drive that also moves the neighbouring joint, as wrists with coupled gears or cables do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from wt.physics.driving import all_drives, force_of_all
from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import neighbours
from wt.physics.hooks import OnSteps
from wt.physics.live import Law, Live, Values
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_LEAST = 0.02
"""Smallest fraction: what is less is an error of some inertia."""


@Law
def _leaking(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    return theta[0] * force_of_all(own, 0, q, v, u)


@register
class PairCrosstalk(OnSteps):
    """τ_b → τ_b + fraction · (force of the drives of a), at a+b."""

    id = "pair.crosstalk"
    kind = "pair"
    parameters = (Parameter("fraction", "-", -2.0, 2.0, 1e-3, neutral=0.0),)
    reference = "J. J. Craig, Introduction to Robotics, Mechanics and Control, 4th ed., 2017, ch. 8"
    native = False
    odds_against = 4.0
    plotted_over = "drive"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Joints that follow one another, either way round, where the first has a drive."""
        driven = {drive.joint for drive in scene.drives}
        pairs = [pair for a, b in neighbours(scene) for pair in ((a, b), (b, a))]
        return [Location("pair", f"{a}+{b}") for a, b in pairs if a in driven]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force of the first joint's drives on the second."""
        a, b = (motion.scene.dof(name) for name in at.name.split("+"))
        return motion.on(b, motion.drive_forces[:, a])

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The fraction."""
        return coefficients

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Add the fraction of the force."""
        pairs = np.array([[scene.dof(name) for name in place.name.split("+")] for place in at])
        return Live(_leaking, pairs[:, 1], theta, all_drives(scene, pairs[:, 0]))

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Refuse some per cent, which inertias are off by."""
        return bool(abs(theta[0]) > _LEAST)

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Add the fraction of the force."""
        a, b = at.name.split("+")
        force = (
            f'_, _, dof = self._joint("{b}", qpos, qvel)',
            f'f[:, dof] += {number(theta[0])} * self._drives("{a}", qpos, qvel, ctrl)',
        )
        return Script(force=force, helpers=("joint", "drives"))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        a, b = at.name.split("+")
        return f"{100 * theta[0]:.3g} % of the force of joint {a}'s drive acts on joint {b}, too."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        a, b = at.name.split("+")
        return f"{b} held still while {a} pushes against something, then moves fast"
