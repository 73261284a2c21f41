"""A planned motion as commands, and what the model as given makes of them."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.physics.activation import following, integrating
from wt.physics.scene import Drive, Scene
from wt.types import Recording

_STEP_S = 5e-4
_SETTLE_S = 20.0
_NUDGE = 1e-3  # rad or m
_CALM = 10.0  # 1/s: damping per inertia while a machine settles


@dataclass(frozen=True, eq=False)
class Trial:
    """Commands and the simulated motion.

    Attributes:
        ctrl: commands.
        q: joint positions [rad or m].
        force: actuator forces [N·m or N].
        touched: pairs of bodies that touched although they do not at rest.
        begun: what each drive acts on at the start.
    """

    ctrl: Float[np.ndarray, "sample actuator"]
    q: Float[np.ndarray, "sample dof"]
    force: Float[np.ndarray, "sample actuator"]
    touched: Int[np.ndarray, "pair 2"]
    begun: Float[np.ndarray, " actuator"]


def trial(scene: Scene, wanted: Float[np.ndarray, "sample dof"], rate: float) -> Trial:
    """Command a motion and simulate it on the model as given.

    Args:
        scene: the machine.
        wanted: joint positions [rad]; the first one is where it starts, at rest.
        rate: samples per second [Hz].
    """
    model = copy.copy(scene.model)
    each = int(np.ceil(1.0 / (rate * min(_STEP_S, model.opt.timestep)) - 1e-9))
    model.opt.timestep = 1.0 / (rate * each)
    acted = setpoints(scene, wanted, 1.0 / rate)
    ctrl = _sent(model, acted, 1.0 / rate)
    data = mujoco.MjData(model)
    data.qpos[:] = wanted[0]
    _charge(model, data, acted[0])
    mujoco.mj_forward(model, data)
    at_rest = _touching(model, data)
    touched: set[tuple[int, int]] = set()
    q, force = np.empty_like(wanted), np.empty_like(ctrl)
    for k, command in enumerate(ctrl):
        data.ctrl[:] = command
        mujoco.mj_forward(model, data)
        q[k], force[k] = data.qpos, data.actuator_force
        if data.ncon:
            touched |= _touching(model, data) - at_rest
        mujoco.mj_step(model, data, each)
    return Trial(ctrl, q, force, np.array(sorted(touched), int).reshape(-1, 2), acted[0])


def as_recording(scene: Scene, tried: Trial, rate: float, source: str, what: str) -> Recording:
    """Commands to send, with the positions that they are expected to lead to.

    Args:
        scene: the machine.
        tried: the motion, simulated on the model as given.
        rate: samples per second [Hz].
        source: what designed it, for the metadata.
        what: it does, in words.
    """
    columns = {
        f"ctrl/{scene.model.actuator(i).name}": tried.ctrl[:, i]
        for i in range(scene.model.nactuator)
    }
    columns |= {f"qpos/{joint}": tried.q[:, scene.dof(joint)] for joint in scene.joints}
    return Recording(
        np.arange(len(tried.q)) / rate,
        columns,
        {
            "source": source,
            "rate": rate,
            "notes": f"Commands to send; {what}. Positions are predicted by the model as given, "
            "not measured. Start from the first of them.",
        },
    )


def touching_along(scene: Scene, q: Float[np.ndarray, "sample dof"]) -> Int[np.ndarray, "pair 2"]:
    """Pairs of bodies that touch somewhere along a motion although they do not where it starts."""
    data = mujoco.MjData(scene.model)
    found: list[set[tuple[int, int]]] = []
    for pose in q:
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(scene.model, data)
        found.append(_touching(scene.model, data))
    return np.array(sorted(set().union(*found) - found[0]), int).reshape(-1, 2)


def setpoints(
    scene: Scene, wanted: Float[np.ndarray, "sample dof"], dt: float
) -> Float[np.ndarray, "sample actuator"]:
    """What drives have to act on for a motion on the model as given.

    A servo gets the position, plus what carries the weight there; a torque motor gets the torque
    of inverse dynamics.
    """
    model = copy.copy(scene.model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # nobody leans on them
    data = mujoco.MjData(model)
    speed = np.gradient(wanted, dt, axis=0)
    acceleration = np.gradient(speed, dt, axis=0)
    acted = np.zeros((len(wanted), model.nactuator))
    loose = [d for d in scene.drives if not d.servo]
    for k, q in enumerate(wanted):
        data.qpos[:] = q
        data.qvel[:], data.qacc[:] = 0.0, 0.0
        mujoco.mj_inverse(model, data)
        weight = data.qfrc_inverse.copy()
        if loose:
            data.qvel[:], data.qacc[:] = speed[k], acceleration[k]
            mujoco.mj_inverse(model, data)
        for d in scene.drives:
            still = d.servo
            torque = weight[d.dof] if still else data.qfrc_inverse[d.dof]
            acted[k, d.index] = command(d, q[d.dof], 0.0 if still else speed[k, d.dof], torque)
    for d in scene.drives:
        acted[:, d.index] = np.clip(acted[:, d.index], *d.commands)
    return acted


def _sent(
    model: mujoco.MjModel, acted: Float[np.ndarray, "sample actuator"], dt: float
) -> Float[np.ndarray, "sample actuator"]:
    """Commands by which drives come to act on something: of integrators, its rate."""
    ctrl = acted.copy()
    for i in integrating(model):
        ctrl[:, i] = np.gradient(ctrl[:, i], dt)
    for i in np.flatnonzero(model.actuator_ctrllimited):
        ctrl[:, i] = np.clip(ctrl[:, i], *model.actuator_ctrlrange[i])
    return ctrl


def command(drive: Drive, q: float, v: float, torque: float) -> float:
    """Command that makes a drive give a torque on its joint [N·m] at a position and speed of it."""
    if drive.gain == 0.0 or drive.gear == 0.0:
        return 0.0
    passive = drive.bias[0] + drive.gear * (drive.bias[1] * q + drive.bias[2] * v)
    return float((torque / drive.gear - passive) / drive.gain)


def settled(
    scene: Scene, pose: Float[np.ndarray, " dof"], towards: Float[np.ndarray, " dof"]
) -> Float[np.ndarray, " dof"]:
    """Pose in which a machine comes to rest when its torque motors give nothing [rad or m].

    Servos hold their joints; a machine that only has servos stays as it is. What stands on its head
    falls towards a pose that was seen.
    """
    servo = np.zeros(scene.model.nv, bool)
    servo[[d.dof for d in scene.drives if d.servo]] = True
    if servo.all():
        return pose
    model = copy.copy(scene.model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.timestep = 2e-3
    model.dof_damping[~servo] += _CALM * model.dof_M0[~servo]
    data = mujoco.MjData(model)
    # it would not fall by itself
    data.qpos[:] = pose + _NUDGE * ~servo * np.where(towards < pose, -1.0, 1.0)
    for d in scene.drives:
        data.ctrl[d.index] = command(d, pose[d.dof], 0.0, 0.0) if d.servo else 0.0
    _charge(model, data, data.ctrl.copy())
    data.ctrl[integrating(model)] = 0.0
    mujoco.mj_step(model, data, round(_SETTLE_S / model.opt.timestep))
    stays = np.abs(data.qpos - pose) < 2.0 * _NUDGE
    return np.where(servo | stays, pose, data.qpos)


def _charge(
    model: mujoco.MjModel, data: mujoco.MjData, ctrl: Float[np.ndarray, " actuator"]
) -> None:
    """Let filters and integrators of actuators start with what they are to act on."""
    for i in following(model):
        data.act[model.actuator_actadr[i]] = ctrl[i]


def _touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[int, int]]:
    bodies = model.geom_bodyid[data.contact.geom[data.contact.dist < 0.0]]
    return {(int(min(pair)), int(max(pair))) for pair in bodies}
