"""A drive that receives its command late."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.hooks import OnInputs, Tolerance, Tolerated
from wt.physics.motion import Motion
from wt.physics.replay import Inputs
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_OFF = 4e-4  # s, standard deviation of when commands arrive

_LINEAR = 1


@register
class ActuatorDelay(OnInputs, Tolerated):
    """u(t) → u(t − delay), of one drive or, at ``all``, of every one."""

    id = "actuator.delay"
    kind = "actuator"
    parameters = (Parameter("delay", "s", 0.0, 0.3, 1e-4, neutral=0.0),)
    reference = "MuJoCo XML reference, actuator/general/delay"
    signed = (1,)
    looks_like = ("delay",)
    common = "always"
    plotted_over = "velocity"
    correctable = False

    def places(self, scene: Scene) -> Sequence[Location]:
        """All drives together, as one slow bus makes them late, or one."""
        single = super().places(scene)
        return [Location("actuator", "all"), *single] if len(single) > 1 else single

    def same_as(self, scene: Scene, at: Location) -> Sequence[tuple[str, Location]]:
        """Late measurements, where all commands are late: only the time between them shows."""
        if scene.free or len(scene.driven(at)) < len(scene.drives):
            return ()
        joints = [Location("joint", name) for name in scene.own_joints]
        return [("sensor.delay", Location("sensor", "all") if len(joints) > 1 else joints[0])]

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Delays from half a sample up."""
        return [(d,) for d in motion.dt * np.array([0.5, 1, 2, 4, 8, 16]) if d < 0.3]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force under the delayed command minus force under the command as sent."""
        force = np.zeros((*motion.q.shape, 1))
        for drive in motion.scene.driven(at):
            late = motion.delayed(drive.index, shape[0])
            force += motion.on(drive.dof, motion.force(drive, late) - motion.force(drive))
        return force

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """To first order, c times the force of a delay d is the force of a delay c · d."""
        return coefficients * shape[0]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Set the actuator's ``delay`` and a buffer that is long enough."""
        if theta[0] <= 0.0:
            return
        # a passive motor, which another patch may have added, has no command
        commanded = [a for a in spec.actuators if a.ctrlspec != mujoco.mjtCtrlInput.mjINPUT_NONE]
        for actuator in commanded if at.name == "all" else [spec.actuator(at.name)]:
            actuator.delay += theta[0]
            actuator.nsample = int(np.ceil(actuator.delay / spec.option.timestep)) + 1
            # between two steps a command arrives in part, as one that is held between them does
            actuator.interp = _LINEAR

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Shift the command; at ``all`` also that of actuators which are no joint's drive."""
        every = at.name == "all"
        for i in range(scene.model.nu) if every else [scene.drive(at.name).index]:
            inputs.u[:, i] = inputs.delayed(inputs.u[:, i], float(theta[0]))

    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """Every drive's."""
        return {Location("actuator", drive.name): Tolerance(_OFF) for drive in scene.drives}

    def small(self, motion: Motion, at: Location, size: float) -> Float[np.ndarray, "sample dof"]:
        """Force of a delay of that size: it is the shape, with coefficient one."""
        return np.asarray(self.columns(motion, at, (size,))[:, :, 0])

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        late = f"{1e3 * theta[0]:.3g} ms late"
        if at.name == "all":
            return f"The commands of all actuators arrive {late}."
        return f"Actuator {at.name} receives its commands {late}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        what = "each joint" if at.name == "all" else f"the joint of {at.name}"
        return (
            f"a fast multisine with a second sensor at {what}, or of currents, that has the clock "
            "of the commands: late commands move it late, late measurements do not"
        )
