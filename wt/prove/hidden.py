"""The hidden world: a rig on bare MuJoCo stepping, its servo and every effect integrated here.

The model has no actuators and no damping; all torques are computed in this package and applied.
MuJoCo's semi-implicit Euler is a leapfrog: velocities live half a step before positions, and a
force acts from half a step before its time until half a step after. So laws and recordings see
q̇ + h/2·q̈, and the servo the command's mean over that interval: the world is of second order in h.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.prove.legged_rigs import Legged
from wt.prove.rigs import Rig, nominal_xml
from wt.prove.trajectory import HiddenTrajectory as HiddenTrajectory

Parameters = dict[str, object]
"""Parameters of an effect by the names of the interface, SI units."""
Controller = Callable[
    [int, Float[np.ndarray, " joint"], Float[np.ndarray, " joint"]], Float[np.ndarray, " joint"]
]
"""(sample, q, q̇) → command, held until the next sample."""


class HiddenLaw:
    """One effect at one place. A law overrides the hooks of the stage at which it acts.

    Attributes:
        fine: true if the law is stiff and asks for half the rig's step.
    """

    fine = False

    def __init__(self, place: str, parameters: Parameters, rng: np.random.Generator) -> None:
        """Take the parameters.

        Args:
            place: MJCF name, ``a+b`` or ``world``.
            parameters: by the names of the interface, SI units.
            rng: draws what the parameters leave open (bristle stiffness, …).
        """
        self.place, self.parameters, self.rng = place, parameters, rng

    def number(self, name: str) -> float:
        """A scalar parameter."""
        return float(self.parameters[name])  # type: ignore[arg-type]

    def vector(self, name: str) -> Float[np.ndarray, " ..."]:
        """A parameter of several numbers."""
        return np.array(self.parameters[name], dtype=float)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Change the rig before it is compiled."""

    def bind(self, plant: Plant) -> None:
        """Change the compiled model; look up what the other hooks need."""

    def settle(self, plant: Plant) -> None:
        """Put loose parts in their places, before the lead-in of a recording."""

    def start(self) -> None:
        """The recording's first sample: the motor is cold."""


class CommandLaw(HiddenLaw):
    """Acts on the command before the servo."""

    def command(self, u: float) -> float:
        """Command that the servo gets [rad or N·m] for the one that was sent."""
        return u


class TorqueLaw(HiddenLaw):
    """Acts on the actuator's torque."""

    def torque(self, tau: float, q: float, v: float) -> float:
        """Torque that comes out [N·m] at joint position q [rad] and velocity v [rad/s]."""
        return tau


class GearLaw(HiddenLaw):
    """Stands between the motor, which it integrates, and the joint."""

    angle: float
    rate: float

    def advance(self, tau: float, q: float, v: float) -> float:
        """Torque on the joint [N·m] while the motor turns for one step under ``tau``."""
        return tau


class JointLaw(HiddenLaw):
    """Acts at a joint."""

    def joint(self, q: float, v: float, drive: float) -> float:
        """Added torque [N·m]; ``drive`` is the torque that the drive transmits [N·m]."""
        return 0.0


class WorldLaw(HiddenLaw):
    """Acts on bodies, or on several joints."""

    def act(self, plant: Plant, t: float) -> None:
        """Add to ``plant.data.xfrc_applied`` or ``plant.total`` at time t [s] of the recording."""


class Plant:
    """A rig with its hidden physics, stepped one fine step at a time."""

    def __init__(
        self,
        rig: Rig,
        laws: Sequence[HiddenLaw],
        gain: float,
        tolerances: Float[np.ndarray, "2 joint"],
        step: float | None = None,
        interval: float = 0.01,
    ) -> None:
        """Build and compile.

        Args:
            rig: the robot.
            laws: the hidden effects.
            gain: factor on servo stiffness, as in the nominal model.
            tolerances: model tolerances: factors on each link's mass (row 0) and damping (row 1).
            step: time step [s]; the rig's when None, halved for stiff laws.
            interval: from one command to the next [s].
        """
        spec = mujoco.MjSpec.from_string(nominal_xml(rig, gyro=True))
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        for law in laws:
            law.edit(spec)
        self.rig, self.model, self.interval = rig, spec.compile(), interval
        fine = any(law.fine for law in laws)
        self.h = step or rig.step * (0.5 if fine and rig.step > 3e-4 else 1.0)
        self.model.opt.timestep = self.h
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        hinges = [self.model.joint(name) for name in rig.joints]
        self.q_at = np.array([int(hinge.qposadr[0]) for hinge in hinges])
        self.v_at = np.array([int(hinge.dofadr[0]) for hinge in hinges])
        self._servo(gain, tolerances)
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))
        self.data = mujoco.MjData(self.model)
        self.total = np.zeros(len(rig.links))
        self.transmitted = np.zeros(len(rig.links))  # by the drives to their joints [N·m]
        for law in laws:
            law.bind(self)
        # inertias may have changed
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))
        self._sort(laws)

    def _servo(self, gain: float, tolerances: Float[np.ndarray, "2 joint"]) -> None:
        links, model = self.rig.links, self.model
        for i, link in enumerate(links):
            body = self.body(link.body)
            model.body_mass[body] *= tolerances[0, i]
            model.body_inertia[body] *= tolerances[0, i]
        self.damping = np.array([link.damping for link in links]) * tolerances[1]
        model.dof_damping[:] = 0.0
        self.kp = np.array([link.kp * gain for link in links])
        self.kv = np.array([link.kv * gain**0.5 for link in links])
        self.limit = np.array([link.limit for link in links])

    def _sort(self, laws: Sequence[HiddenLaw]) -> None:
        def of(kind: type) -> list[tuple[int, HiddenLaw]]:
            return [(self.index(law.place), law) for law in laws if isinstance(law, kind)]

        self._command, self._torque, self._gear = of(CommandLaw), of(TorqueLaw), of(GearLaw)
        self._joint = of(JointLaw)
        self._world = [law for law in laws if isinstance(law, WorldLaw)]
        self._laws = list(laws)

    def index(self, place: str) -> int:
        """Index of a joint, given its name or its actuator's."""
        return self.rig.joints.index(place.removesuffix("_drive"))

    def dof(self, place: str) -> int:
        """MuJoCo's index of a joint's velocity, given its name or its actuator's."""
        return int(self.v_at[self.index(place)])

    def body(self, name: str) -> int:
        """MuJoCo's id of a body."""
        return mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)

    def inertia(self, joint: int) -> float:
        """Inertia about a joint, all else locked, where motions happen [kg·m²], with armature."""
        data = mujoco.MjData(self.model)
        data.qpos[self.q_at] = [link.middle for link in self.rig.links]
        mujoco.mj_forward(self.model, data)
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, full)
        dof = self.v_at[joint]
        return float(full[dof, dof])

    def gravity_torques(
        self, path: Float[np.ndarray, "sample joint"]
    ) -> Float[np.ndarray, "sample joint"]:
        """Torques that hold the rig still [N·m], effects on joints left out.

        Args:
            path: positions [rad].
        """
        data, out = mujoco.MjData(self.model), np.empty_like(path)
        for row, q in enumerate(path):
            data.qpos[self.q_at] = q
            mujoco.mj_fwdPosition(self.model, data)
            mujoco.mj_fwdVelocity(self.model, data)
            out[row] = data.qfrc_bias[self.v_at]
        return out

    def run(
        self,
        q0: Float[np.ndarray, " joint"],
        samples: Int[np.ndarray, " sample"],
        controller: Controller,
        lead: int,
    ) -> HiddenTrajectory:
        """Step through a recording.

        Args:
            q0: initial positions [rad].
            samples: increasing step indices of samples; step 0 is time 0.
            controller: (sample, q, q̇) → command, held until the next sample.
            lead: steps of lead-in before time 0, in which sample 0 is held.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._stand(q0)
        for _, gear in self._gear:
            gear.angle, gear.rate = float(q0[self.index(gear.place)]), 0.0  # type: ignore[attr-defined]
        mujoco.mj_step1(self.model, self.data)
        u = before = controller(0, q0, np.zeros_like(q0))
        shape = len(samples), len(self.rig.links), int(samples[-1]) + 1
        trace = HiddenTrajectory(*shape, self.h, self.model.nsensordata)
        row, stride = 0, max(1, round(float(np.median(np.diff(samples)))))
        # looked up once: views of what MuJoCo steps
        qpos, qvel, qacc = self.data.qpos, self.data.qvel, self.data.qacc
        half, rows = 0.5 * self.h, samples.tolist()
        for k in range(-lead, rows[-1] + 1):
            mujoco.mj_step1(self.model, self.data)
            speed = qvel + half * qacc
            q, v = qpos[self.q_at], speed[self.v_at]
            if k == 0:
                for law in self._laws:
                    law.start()
            if k == rows[row]:
                u = controller(row, q, v)
                trace.put(row, q, v, u, self.data.sensordata)
                if self.floats:
                    trace.base_q[row], trace.base_v[row] = qpos[:7], speed[:6]
                row += 1
            elif k < 0 and k % stride == 0:
                u = controller(0, q, v)
            tau = self._finish(q, v, 0.5 * (before + u), k * self.h)
            before = u
            if k >= 0:
                trace.fine_q[k], trace.fine_v[k], trace.fine_tau[k] = q, v, tau
            mujoco.mj_step2(self.model, self.data)
        return trace

    @property
    def floats(self) -> bool:
        """True if the robot has a free joint, which is then the first one."""
        return isinstance(self.rig, Legged)

    def _stand(self, q0: Float[np.ndarray, " joint"]) -> None:
        """Joints at q0 [rad], the lowest foot on the floor, and loose parts in their places."""
        self.data.qpos[self.q_at] = q0
        if isinstance(self.rig, Legged):
            mujoco.mj_kinematics(self.model, self.data)
            heights = [self.data.geom(f.name).xpos[2] - f.size[-1] for f in self.rig.feet]
            self.data.qpos[2] -= min(heights)
        for law in self._laws:
            mujoco.mj_kinematics(self.model, self.data)
            law.settle(self)

    def _finish(
        self,
        q: Float[np.ndarray, " joint"],
        v: Float[np.ndarray, " joint"],
        u: Float[np.ndarray, " joint"],
        t: float,
    ) -> Float[np.ndarray, " joint"]:
        """Set the applied forces of one step; returns the drives' torques on the joints."""
        if self._command:
            u = u.copy()
            for i, law in self._command:
                u[i] = law.command(float(u[i]))  # type: ignore[attr-defined]
        # τ = kp·(u − q) − kv·q̇, with q and q̇ on the motor's side of the gear
        motor_q, motor_v = q, v
        if self._gear:
            motor_q, motor_v = q.copy(), v.copy()
            for i, law in self._gear:
                motor_q[i], motor_v[i] = law.angle, law.rate  # type: ignore[attr-defined]
        tau = u.copy() if self.rig.motor else self.kp * (u - motor_q) - self.kv * motor_v
        tau.clip(-self.limit, self.limit, out=tau)
        for i, law in self._torque:
            tau[i] = law.torque(float(tau[i]), float(motor_q[i]), float(motor_v[i]))  # type: ignore[attr-defined]
        for i, law in self._gear:
            tau[i] = law.advance(float(tau[i]), float(q[i]), float(v[i]))  # type: ignore[attr-defined]
        self.transmitted[:] = tau
        np.subtract(tau, self.damping * v, out=self.total)
        for i, law in self._joint:
            self.total[i] += law.joint(float(q[i]), float(v[i]), float(tau[i]))  # type: ignore[attr-defined]
        if self._world:
            self.data.xfrc_applied[:] = 0.0
            for world in self._world:
                world.act(self, t)
        self.data.qfrc_applied[self.v_at] = self.total
        return tau
