"""A drive with a constant force too much."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.activation import integrating
from wt.physics.effect import Effect, Parameter, Shape, register
from wt.physics.effects._tools import free_of_limits
from wt.physics.motion import Motion
from wt.physics.parts import settle
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class ActuatorBias(Effect):
    """force → force + torque."""

    id = "actuator.bias"
    kind = "actuator"
    parameters = (Parameter("torque", "N·m", -1e8, 1e8, 1e-3, neutral=0.0),)
    reference = "MuJoCo XML reference, actuator/general/biasprm"
    signed = (0,)
    looks_like = ("spring", "offset")
    common = "always"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives, but for those that integrate: where these began says as much and is not known."""
        unknown = integrating(scene.model)
        return [Location("actuator", d.name) for d in scene.drives if d.index not in unknown]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """1, except where the drive is at its limit."""
        drive = motion.scene.drive(at.name)
        return motion.on(drive.dof, free_of_limits(motion, drive))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The torque on the joint."""
        return coefficients

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Add to the constant part of the actuator's ``biasprm``."""
        settle(spec)
        actuator = spec.actuator(at.name)
        if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE and theta[0] != 0.0:
            actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            actuator.biasprm[:3] = 0.0
        actuator.biasprm[0] += theta[0] / actuator.gear[0]

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        constant = f"a constant {theta[0]:.3g} {units.force}"
        return f"Actuator {at.name} adds {constant} that nobody commanded."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"holding the joint of {at.name} still at poses where gravity pulls it either way"
