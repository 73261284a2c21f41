"""A drive that follows its command through a first-order filter."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import OnInputs
from wt.physics.motion import Motion
from wt.physics.replay import Inputs
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location


@register
class ActuatorLag(OnInputs):
    """time_constant · dx/dt = u − x, and the drive acts on x."""

    id = "actuator.lag"
    kind = "actuator"
    parameters = (Parameter("time_constant", "s", 0.0, 2.0, 1e-4, neutral=0.0),)
    reference = "MuJoCo XML reference, actuator/general/dyntype (filterexact)"
    signed = (1,)
    looks_like = ("delay",)
    plotted_over = "velocity"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives that the model gives no dynamics yet."""
        none = mujoco.mjtDyn.mjDYN_NONE
        return [
            Location("actuator", d.name)
            for d in scene.drives
            if scene.model.actuator_dyntype[d.index] == none
        ]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Time constants from half a sample up."""
        return [(tc,) for tc in motion.dt * np.array([0.5, 1, 2, 4, 8, 16, 32]) if tc < 1.0]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force under the filtered command minus force under the command as sent."""
        drive = motion.scene.drive(at.name)
        late = np.empty(len(motion))
        for s in motion.segments:
            u = motion.command[s.rows, drive.index]
            # two half intervals a sample: the mean over the one centred on a sample is
            # that of the half before it and the half after
            halves = _lagged(np.repeat(u, 2), 0.5 * s.dt, shape[0])
            before = np.concatenate([halves[:1], halves[1:-1:2]])
            late[s.rows] = 0.5 * (before + halves[::2])
        change = motion.force(drive, late) - motion.force(drive)
        return motion.on(drive.dof, change)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """To first order, c times the force of a lag τ is the force of a lag c · τ."""
        return coefficients * shape[0]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Give the actuator a filter as its dynamics."""
        actuator = spec.actuator(at.name)
        if theta[0] > 0.0 and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE:
            actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            actuator.dynprm[0] = theta[0]
            # what a user's class says of filters is about none of this one
            actuator.actearly, actuator.actdim = False, -1
            actuator.actlimited = mujoco.mjtLimited.mjLIMITED_FALSE

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Filter the command, starting in balance with the first."""
        i = scene.drive(at.name).index
        if theta[0] > 0.0:
            inputs.u[:, i] = _lagged(inputs.u[:, i], inputs.h, float(theta[0]))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Actuator {at.name} follows its commands with a time constant of "
            f"{1e3 * theta[0]:.3g} ms."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"steps of {at.name}, whose first milliseconds tell a lag from a delay"


def _lagged(
    u: Float[np.ndarray, " interval"], h: float, time_constant: float
) -> Float[np.ndarray, " interval"]:
    """Mean of the filtered signal over each interval of a held one, (n,)."""
    if time_constant <= 0.0:
        return u
    keep = np.exp(-h / time_constant)
    # x at the end of each interval: x[k] = keep · x[k−1] + (1 − keep) · u[k]
    end = lfilter([1.0 - keep], [1.0, -keep], u, zi=[keep * u[0]])[0]
    start = np.concatenate([u[:1], end[:-1]])
    # ∫x = ∫(u − τ·dx/dt)
    return np.asarray(u - time_constant * (end - start) / h)
