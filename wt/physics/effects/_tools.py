"""Tools that several effects share: drives with another law, units, exact edits of an MJCF."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.motion import Motion
from wt.physics.parts import (
    add_actuator,
    add_body,
    add_geom,
    compiled,
    settle,
    weigh_alone,
    write_weight,
)
from wt.physics.scene import Drive, Scene

_LOAD_RADIUS = 0.01  # m, of the sphere that stands for a load
_VARIES = 0.05  # least share of its farthest stretch that a spring's way makes up
_NOTICED = 1e-4
"""Share of the largest that is next to nothing."""
_HEAVIEST, _BEYOND, _MOUNT = 10.0, 2.0, 0.05
"""A load is no heavier than so many machines, and sits within so many radii of what carries it, and
so much for its mount [m]."""

TURN = (-2.0 * np.pi, 2.0 * np.pi)
"""Bounds of an angle that comes round [rad]: a turn more than it takes, either way."""


def bearing(angle: float) -> str:
    """An angle [rad] that comes round in degrees, from −180 to 180, e.g. ``"-3.1°"``."""
    degrees = np.degrees(np.angle(np.exp(1j * angle)))
    return f"{round(float(degrees), 1) + 0.0:g}°"


def free_of_limits(motion: Motion, drive: Drive) -> Float[np.ndarray, " sample"]:
    """1 where a drive's force is inside the model's force range and 0 where clipped, (T,)."""
    dof = drive.dof
    force = drive.unclamped(motion.u[:, drive.index], motion.q[:, dof], motion.v[:, dof])
    low, high = drive.forces
    return ((force > low) & (force < high)).astype(float)


def noticeable(
    values: Float[np.ndarray, " value"], of: Float[np.ndarray, " sample"]
) -> list[float]:
    """Those of some values that are not next to nothing beside the largest of what they are of."""
    least = _NOTICED * float(np.max(of, initial=0.0))
    return [float(value) for value in values if value > least]


def per_radian(joint: mujoco.MjsJoint) -> float:
    """Units of angles in a joint's attributes per radian: 180/π in a file in degrees."""
    hinge = joint.type == mujoco.mjtJoint.mjJNT_HINGE
    return 180.0 / np.pi if hinge and joint.compiler.degree else 1.0


def effective_inertia(model: mujoco.MjModel, joint: str) -> float:
    """Inertia that a torque on one joint meets when all others are free to move [kg·m²]."""
    return float(1.0 / model.dof_invweight0[model.joint(joint).dofadr[0]])


def add_dry_friction(spec: mujoco.MjSpec, joint: str, torque: float) -> None:
    """Add to a joint's ``frictionloss``, stiff enough that a joint at rest hardly creeps."""
    element = spec.joint(joint)
    element.frictionloss += torque
    element.solref_friction = [0.002, 1.0]
    element.solimp_friction = [0.999, 0.9999, 0.001, 0.5, 2.0]


def mean_weight(model: mujoco.MjModel, joint: str) -> float:
    """Mean size of the torque that gravity puts on a joint over one turn of it [N·m]."""
    data = mujoco.MjData(model)
    j = model.joint(joint)
    weights = []
    for turn in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        mujoco.mj_resetData(model, data)
        data.qpos[j.qposadr[0]] += turn
        mujoco.mj_forward(model, data)
        weights.append(abs(float(data.qfrc_bias[j.dofadr[0]])))
    return float(np.mean(weights))


def neighbours(scene: Scene) -> list[tuple[str, str]]:
    """Pairs of joints that follow one another in the machine, the one nearer to its base first."""
    m, pairs = scene.model, list[tuple[str, str]]()
    for name in scene.own_joints:
        body, before = int(m.joint(name).bodyid[0]), m.joint(name).id - 1
        while body > 0 and not (before >= m.body_jntadr[body] >= 0):
            body = int(m.body_parentid[body])
            before = int(m.body_jntadr[body] + m.body_jntnum[body]) - 1
        if body > 0 and m.joint(before).name in scene.own_joints:
            pairs.append((m.joint(before).name, name))
    return pairs


def physics_step(spec: mujoco.MjSpec) -> float:
    """Time step that an added stiff part must be stable at [s]."""
    return max(float(spec.option.timestep), 5e-4)


def weighed(spec: mujoco.MjSpec, body: str) -> mujoco.MjsBody:
    """A body whose inertia is written out as numbers, ready to be changed."""
    settle(spec)
    weigh_alone(spec)
    written = spec.body(body)
    if not _in_numbers(written):
        model = compiled(spec)
        write_weight(written, model, model.body(body).id)
    return written


def _in_numbers(body: mujoco.MjsBody) -> bool:
    """Tell whether a body's inertia stands in the file as the compiler would write it."""
    quaternion = body.ialt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT
    return bool(body.explicitinertial and quaternion and np.isnan(body.fullinertia[0]))


def passive(
    spec: mujoco.MjSpec, name: str, joint: str, **features: list[float]
) -> mujoco.MjsActuator:
    """Add a passive motor to a joint: no command, no back-EMF, only the features given.

    The user's actuators keep their order and their commands.
    """
    motor = add_actuator(spec, name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    no_input = int(mujoco.mjtCtrlInput.mjINPUT_NONE)
    motor.set_to_dcmotor(motorconst=[0, 0], resistance=1, ctrlspec=no_input, **features)
    return motor


def point_load(
    spec: mujoco.MjSpec, body: str, mass: float, position: Float[np.ndarray, " 3"]
) -> mujoco.MjsBody | None:
    """Weld a small sphere without contacts to a body, on a body of its own; None if it is nothing.

    A geom on the body itself would not count where the body's inertia is written out.
    """
    settle(spec)
    if mass <= 0.0:
        return None
    load = add_body(spec, spec.body(body), f"{body}_payload", pos=position)
    load.explicitinertial = True
    load.mass = mass
    # without a position MuJoCo would not write the inertia into the file
    load.ipos = np.zeros(3)
    load.inertia = np.full(3, 0.4 * mass * _LOAD_RADIUS**2)
    size = [_LOAD_RADIUS, 0.0, 0.0]
    add_geom(spec, load, f"{body}_payload", size=size, mass=mass, contype=0, conaffinity=0)
    return load


def place_of_load(
    coefficients: Float[np.ndarray, " 4"], centre: Sequence[float]
) -> Float[np.ndarray, " 3"]:
    """Position of a load, (3,) [m], from its mass and its first moments about a centre."""
    mass = coefficients[0]
    size = max(abs(mass), 1e-9)
    return np.array(centre) + coefficients[1:] / (size if mass >= 0.0 else -size)


def carried(scene: Scene, body: str, mass: float, position: Float[np.ndarray, " 3"]) -> bool:
    """Tell whether a body may carry a load [kg] at a position [m] in its frame."""
    machine = float(scene.model.body_mass.sum())
    return mass <= _HEAVIEST * machine and within_reach(scene, body, position)


def within_reach(scene: Scene, body: str, position: Float[np.ndarray, " 3"]) -> bool:
    """Tell whether a weight at a position [m] in a body's frame may be that body's.

    It has to be inside the body, or close to it. Where nothing holds the base, a load on the trunk
    moves, but for little, like one that sticks out far from a hip: there it is, in radii of each,
    no closer to the bodies next to it. A machine that is held tells how its joints turn a load.
    """
    m = scene.model
    b = m.body(body).id
    away, radius = _away(m, b, position)
    if away <= radius or not radius:
        return True
    if away > _BEYOND * radius + _MOUNT:
        return False
    if not scene.free:
        return True
    children = [int(c) for c in np.flatnonzero(m.body_parentid == b)]
    nearer = [_away(m, c, _turn(m, c).T @ (position - m.body_pos[c])) for c in children]
    if parent := int(m.body_parentid[b]):
        nearer.append(_away(m, parent, m.body_pos[b] + _turn(m, b) @ position))
    return all(away / radius <= other / size for other, size in nearer if size)


def _away(m: mujoco.MjModel, body: int, position: Float[np.ndarray, " 3"]) -> tuple[float, float]:
    """Distance from a body's centre, and the body's radius, zero without geoms [m]."""
    geoms, centre = np.flatnonzero(m.geom_bodyid == body), m.body_ipos[body]
    sizes = np.linalg.norm(m.geom_pos[geoms] - centre, axis=1) + m.geom_rbound[geoms]
    return float(np.linalg.norm(position - centre)), float(sizes.max(initial=0.0))


def _turn(m: mujoco.MjModel, body: int) -> Float[np.ndarray, "3 3"]:
    """From a body's frame to its parent's, as the model is at rest, (3, 3)."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, m.body_quat[body])
    return turn.reshape(3, 3)


def no_spring(stretch: Float[np.ndarray, " sample"], reference: float) -> str | None:
    """Why a recording rules out a spring of such a reference, if it does.

    One that hardly pulls harder at one end of its way than at the other pulls as a constant force
    does: its stiffness says nothing.
    """
    farthest = float(np.abs(stretch - reference).max())
    if np.ptp(stretch) >= _VARIES * farthest:
        return None
    return "so far from its rest the spring would pull the same all along, as a constant force does"
