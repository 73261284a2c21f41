"""An end stop where the model has none."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import per_radian
from wt.physics.hooks import FromRecordings
from wt.physics.motion import Motion
from wt.physics.units import HINGE, Units, units_at
from wt.types import Location

_YIELDS_S = 0.01
"""Slowest that a stop springs back [s], far slower than rubber does: it may be entered by so much
per speed of entry, and by its square per acceleration that it holds back."""


@register
class Stop(FromRecordings):
    """side · q ≤ side · position, by a stiff one-sided force."""

    id = "joint.stop"
    kind = "joint"
    parameters = (
        Parameter("position", "rad", -20.0, 20.0, 2e-3),
        Parameter("side", "±1", -1.0, 1.0, 0.0),
    )
    reference = "K. Hunt and F. Crossley, Coefficient of restitution as damping, ASME JAM 1975"
    reads_residual = True
    stiff = True
    signed = (1,)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Just inside either end of the recorded range."""
        q = motion.q[:, motion.scene.dof(at.name)]
        shapes = []
        for side in (-1.0, 1.0):
            end = float(np.quantile(side * q, 0.995))
            reach = float(np.ptp(q))
            shapes += [(side * (end - f * reach), side) for f in (0.002, 0.01, 0.03)]
        return shapes

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """All that pushes towards the stop in the last bit of the way, taken back."""
        dof = motion.scene.dof(at.name)
        position, side = shape
        beyond = side * (motion.q[:, dof] - position) > 0.0
        push = np.maximum(-side * motion.residual[:, dof], 0.0)
        return motion.on(dof, -side * beyond * push)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The shape is all there is."""
        return np.array(shape)

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """The joint's ``range``; its other end stays."""
        joint = spec.joint(at.name)
        limited = joint.limited != mujoco.mjtLimited.mjLIMITED_FALSE and any(joint.range)
        low, high = joint.range if limited else (-1e3, 1e3)
        if theta[1] > 0.0:
            high = theta[0] * per_radian(joint)
        else:
            low = theta[0] * per_radian(joint)
        if low >= high:
            low, high = min(low, high), max(low, high) + 1e-3
        joint.range = [low, high]
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.solref_limit = [0.004, 1.0]

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """The joint goes on beyond it, farther than a stop yields to that speed and force."""
        position, side = theta
        dof = motion.scene.dof(at.name)
        depth = side * (motion.q[:, dof] - position)
        held = np.maximum(-side * motion.residual[:, dof], 0.0) / motion.scene.model.dof_M0[dof]
        for s in motion.segments:
            beyond = depth[s.rows] > 0.0
            entered = np.flatnonzero(beyond & ~np.append(False, beyond[:-1]))
            speed = float(np.abs(motion.v[s.rows, dof])[entered].max(initial=0.0))
            pressed = float(held[s.rows][beyond].max(initial=0.0))
            least = self.parameters[0].step + _YIELDS_S * (speed + _YIELDS_S * pressed)
            if (farthest := float(depth[s.rows].max())) > least:
                units = units_at(motion.scene, at)
                return f"the joint goes {units.distance(farthest, 2)} beyond it"
        return None

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        said = units.distance(theta[0])
        where = said if units.slide else f"{theta[0]:.3g} rad ({said})"
        return f"Joint {at.name} runs into a stop at {where}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"slow moves of {at.name} towards the end of its range, with little force"
