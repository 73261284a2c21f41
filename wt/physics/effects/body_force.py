"""A constant force on a body, such as a counterweight's rope or a draught."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.motion import Motion
from wt.physics.parts import add_actuator, add_site, compiled
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class BodyForce(Effect):
    """A force constant in the world's frame, on the body's centre of mass."""

    id = "body.force"
    kind = "body"
    parameters = (Parameter("force", "N", -1e8, 1e8, 1e-2, ("x", "y", "z"), neutral=0.0),)
    reference = "MuJoCo documentation, computation, transmission by a site with a reference site"
    signed = (0, 0, 0)
    looks_like = ("pull",)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Generalised force per newton along the world's x, y and z."""
        return np.swapaxes(motion.point(at.name).jacobian, 1, 2)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The force."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add a passive motor that pulls a site at the centre of mass along the world's axes.

        Cogging with zero poles and a phase of 90° is a constant: a force without a command.
        """
        if not np.any(theta):
            return
        model = compiled(spec)
        name, world = f"{at.name}_force", f"{at.name}_force_frame"
        add_site(spec, spec.body(at.name), name, pos=model.body(at.name).ipos)
        add_site(spec, spec.worldbody, world)
        motor = add_actuator(spec, name, trntype=mujoco.mjtTrn.mjTRN_SITE, target=name)
        motor.refsite = world
        motor.gear = [*theta, 0.0, 0.0, 0.0]
        motor.set_to_dcmotor(
            motorconst=[0, 0],
            resistance=1,
            cogging=[1.0, 0.0, 0.5 * np.pi],
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
        )

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z = theta
        return f"A constant force of {x:.3g}, {y:.3g}, {z:.3g} N (world x, y, z) acts on {at}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"holding still at poses that move {at.name} far, and fast motions, which tell mass"
