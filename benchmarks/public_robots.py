"""Robots as others publish them, moved in worlds where one thing is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from wt.errors import UserError
from wt.prove.case import HiddenEffect
from wt.types import Recording

Array = np.ndarray

CASES = ("nothing", "friction", "payload", "gain", "delay")
RATE, SECONDS, MOTIONS = 100.0, 10.0, 3  # Hz, s, number of recordings
NOISE, SPEED_NOISE = 1e-4, 2e-3  # rad or m, and per second
REACH, SLIDE = 0.3, 0.1  # rad, m
VISIBLE = 5.0
"""What is hidden changes the positions of some joint by this many times the noise [rms]."""
BANDWIDTH = 1.5  # Hz, of the controller of drives that are told torques
DRAWS, SHRINKS = 40, 8
UNLIMITED = (-np.inf, np.inf)
SETTLING = 20.0  # s
COARSEST, HALVINGS = 2.5e-4, 5
"""Worlds begin with this step, or the model's own if it is smaller [s], and halve it so often."""
SETTLED = 0.2
"""Reality has no step: halving that of a world changes positions by less than this share of the
noise [rms]."""
MOVED = 0.3
"""Every driven joint moves at least this share of what it does with nothing hidden."""


@dataclass(frozen=True)
class Hidden:
    """One thing that the real machine has and the model has not.

    Attributes:
        truth: its effect, place and parameters; None for nothing.
        late: of all commands [physics steps].
    """

    truth: HiddenEffect | None = None
    late: int = 0

    def world(self, robot: Robot) -> mujoco.MjModel:
        """The real machine."""
        spec = mujoco.MjSpec.from_file(str(robot.path))
        spec.option.timestep = robot.step
        truth = self.truth
        if truth and truth.effect == "body.payload_fixed":
            mass, at = truth.parameters["mass"], truth.parameters["position"]
            load = spec.body(truth.name).add_body(pos=at, mass=mass, inertia=[1e-5 * mass] * 3)
            load.explicitinertial = True
            load.ipos = [0.0, 0.0, 0.0]  # left out, it would be the body's own position once more
        model = spec.compile()
        # servos are set to what the machine is without it: MuJoCo would derive a gain from the load
        model.actuator_gainprm[:] = robot.model.actuator_gainprm
        model.actuator_biasprm[:] = robot.model.actuator_biasprm
        if truth and truth.effect == "joint.friction_coulomb":
            model.joint(truth.name).frictionloss += truth.parameters["coulomb"]
        if truth and truth.effect == "actuator.gain":
            model.actuator(truth.name).gainprm *= truth.parameters["factor"]
            model.actuator(truth.name).biasprm *= truth.parameters["factor"]
        return model


class Robot:
    """A model as published, its pose, and what its drives can do.

    Attributes:
        path: MJCF.
        model: of it.
        pose: position coordinates around which it moves.
        servo: which actuators are told positions; the others are told forces.
        moment: (actuator, dof) lever arms there.
        driven: indices of joints that drives act on directly.
        limit: most that drives do, by joint [N·m or N].
        hold: what holds the pose, by joint.
        step: physics step of the worlds [s].
        steps: of these a sample.
    """

    def __init__(self, path: Path, halvings: int = 0) -> None:
        """Read a model whose joints are all hinges and slides."""
        self.path, self.model = path, mujoco.MjModel.from_xml_path(str(path))
        model = self.model
        if model.nu != model.nactuator or np.any(model.actuator_dyntype):
            raise UserError(f"'{path.name}' has drives with states, for which there is no motion")
        self.servo = model.actuator_biasprm[:, 1] < 0
        step = model.opt.timestep / max(1, round(model.opt.timestep / COARSEST))
        steps = max(1, round(1.0 / (RATE * step)))
        self.step, self.steps = step / 2**halvings, steps * 2**halvings
        self.dt = steps * step
        data = mujoco.MjData(model)
        self.moment = self._moment(data)
        self.span = np.where(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, SLIDE, REACH)
        self.driven = np.flatnonzero(np.any(self.moment, axis=0))
        self.pose = self._pose()
        data.qpos = self.pose
        mujoco.mj_forward(model, data)
        self.moment, self.hold = self._moment(data), data.qfrc_bias.copy()
        self.inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, self.inertia)
        self.limit = self._limit()

    def _moment(self, data: mujoco.MjData) -> Array:
        mujoco.mj_forward(self.model, data)
        dense = np.zeros((self.model.nactuator, self.model.nv))
        rows = data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(dense, data.actuator_moment[:, None], *(r[:, None] for r in rows))
        return dense

    def _pose(self) -> Array:
        """The keyframe, as far inside all ranges as joints are to move."""
        model = self.model
        names = [model.key(i).name for i in range(model.nkey)]
        key = names.index("home") if "home" in names else 0
        pose = model.key_qpos[key].copy() if names else model.qpos0.copy()
        low, high = np.where(model.jnt_limited[:, None], model.jnt_range, [-np.inf, np.inf]).T
        room = np.minimum(self.span, 0.4 * (high - low))
        inside = np.clip(pose, low + room, high - room)
        self.span = np.where(np.isin(np.arange(model.njnt), self.driven), room, 0.0)
        return np.where(self.span > 0, inside, pose)

    def _limit(self) -> Array:
        """By ranges of force; where there are none, what 0.1 rad or a full command makes."""
        model = self.model
        most = np.where(
            self.servo,
            -0.1 * model.actuator_biasprm[:, 1],
            np.abs(model.actuator_gainprm[:, 0])
            * np.where(model.actuator_ctrllimited, model.actuator_ctrlrange[:, 1], 1.0),
        )
        ranged = model.actuator_forcelimited.astype(bool)
        most = np.where(ranged, np.minimum(most, model.actuator_forcerange[:, 1]), most)
        limit = np.abs(self.moment).T @ most
        ranged = model.jnt_actfrclimited.astype(bool)
        limit[ranged] = np.minimum(limit, model.jnt_actfrcrange[:, 1])[ranged]
        weight = 9.81 * model.body_subtreemass[0]
        lever = np.where(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, 1.0, model.stat.extent)
        return np.minimum(limit, weight * lever)

    def commands(self, goal: Array) -> Array:
        """Commands (time, actuator) of servos for positions (time, joint); others are NaN."""
        model, data = self.model, mujoco.MjData(self.model)
        u = np.full((len(goal), model.nactuator), np.nan)
        for k, q in enumerate(goal):
            data.qpos = q
            mujoco.mj_fwdPosition(model, data)
            wanted = -model.actuator_biasprm[:, 1] * data.actuator_length
            u[k] = (wanted - model.actuator_biasprm[:, 0]) / model.actuator_gainprm[:, 0]
        return np.where(self.servo, u, np.nan)

    def controlled(self, u: Array, goal: Array, q: Array, v: Array) -> Array:
        """A sample's commands; forces come from a soft controller on what is measured."""
        model, mass = self.model, np.diag(self.inertia)
        rate = 2.0 * np.pi * BANDWIDTH
        force = self.hold + mass * (rate**2 * (goal - q) - 1.8 * rate * v)
        lever = self.moment * model.actuator_gainprm[:, :1] * ~self.servo[:, None]
        u = np.where(self.servo, u, np.linalg.pinv(lever.T) @ force)
        low, high = model.actuator_ctrlrange.T
        return np.where(model.actuator_ctrllimited, np.clip(u, low, high), u)


@dataclass
class Motion:
    """Smooth sums of sines around a robot's pose, the same in every world."""

    robot: Robot
    seed: int
    size: float = 1.0
    goal: Array = field(init=False)
    u: Array = field(init=False)

    def __post_init__(self) -> None:
        """Draw it."""
        robot, rng = self.robot, np.random.default_rng(self.seed)
        self.t = np.arange(round(SECONDS / robot.dt)) * robot.dt
        n = robot.model.njnt
        rate, phase = rng.uniform(0.1, 0.8, (4, n)), rng.uniform(0.0, 2.0 * np.pi, (4, n))
        share = rng.dirichlet(np.full(4, 4.0), n).T  # they sum to the span at most
        sines = np.sin(2.0 * np.pi * self.t[:, None, None] * rate + phase)
        soft = np.minimum(self.t / 2.0, 1.0)[:, None]
        self.goal = robot.pose + self.size * robot.span * soft * (share * sines).sum(axis=1)
        self.u = robot.commands(self.goal)

    def run(self, hidden: Hidden, noise: float = NOISE) -> tuple[Recording, bool]:
        """What a machine records, and whether that strains it.

        It does where anything touches that does not touch at rest, or a drive is at its limit.
        """
        robot, model = self.robot, hidden.world(self.robot)
        rng = np.random.default_rng([self.seed, 1])
        data, step = mujoco.MjData(model), model.opt.timestep
        data.qpos[:] = robot.pose + np.where(robot.span > 0, 0.0, 1e-2)
        for _ in range(round(SETTLING / step / robot.steps)):
            data.ctrl[:] = robot.controlled(self.u[0], self.goal[0], data.qpos, data.qvel)
            for _ in range(robot.steps):
                mujoco.mj_step(model, data)
                data.qvel *= np.exp(-2.0 * step)  # what no drive holds comes to rest, too
        resting = _touching(data)
        n, sent, strained = len(self.t), [data.ctrl.copy()] * (hidden.late + 1), False
        limited = model.actuator_forcelimited[:, None]
        low, high = np.where(limited, model.actuator_forcerange, UNLIMITED).T
        q, v, u = (np.empty((n, size)) for size in (model.nq, model.nv, model.nactuator))
        for k in range(n):
            q[k] = data.qpos + noise * rng.standard_normal(model.nq)
            v[k] = data.qvel + SPEED_NOISE / NOISE * noise * rng.standard_normal(model.nv)
            u[k] = robot.controlled(self.u[k], self.goal[k], q[k], v[k])
            for _ in range(robot.steps):
                sent = [*sent[1:], u[k]] if hidden.late else [u[k]]
                data.ctrl[:] = sent[0]
                mujoco.mj_step(model, data)
                strained |= data.ncon > 0 and not _touching(data) <= resting
            force = data.actuator_force
            strained |= bool(np.any((force <= low) | (force >= high)))
        columns = {f"qpos/{_name(robot.model, i, 'joint')}": q[:, i] for i in range(model.nq)}
        columns |= {f"qvel/{_name(robot.model, i, 'joint')}": v[:, i] for i in range(model.nv)}
        columns |= {f"ctrl/{_name(robot.model, i, 'actuator')}": u[:, i] for i in range(u.shape[1])}
        return Recording(self.t, columns), strained


def motions(robot: Robot, seed: int) -> list[Motion]:
    """Motions of a robot, small enough not to strain it."""
    made = []
    for number in range(MOTIONS):
        motion = Motion(robot, 100 * seed + number)
        for _ in range(SHRINKS):
            if not motion.run(Hidden(), 0.0)[1]:
                break
            motion = replace(motion, size=0.7 * motion.size)
        made.append(motion)
    return made


def settled(made: Sequence[Motion]) -> list[Motion]:
    """The same motions of a robot whose step is so fine that a finer one would show nothing new."""
    first, path = made[0], made[0].robot.path
    moved = _positions(first.run(Hidden(), 0.0)[0])
    for halvings in range(1, HALVINGS + 1):
        finer = Robot(path, halvings)
        before, moved = moved, _positions(replace(made[0], robot=finer).run(Hidden(), 0.0)[0])
        if np.sqrt(np.mean((moved - before) ** 2, axis=0)).max() < SETTLED * NOISE:
            break
        first = replace(made[0], robot=finer)
    return [replace(motion, robot=first.robot) for motion in made]


def draw(robot: Robot, case: str, rng: np.random.Generator, strength: float = 1.0) -> Hidden:
    """What might be hidden in a robot, so many times as strong as usual."""
    model = robot.model
    if case == "friction":
        joint = int(rng.choice(robot.driven))
        coulomb = float(strength * rng.uniform(0.03, 0.08) * robot.limit[joint])
        name = _name(model, joint, "joint")
        return Hidden(_truth("joint.friction_coulomb", "joint", name, {"coulomb": coulomb}))
    if case == "payload":
        return Hidden(_payload(robot, rng, strength))
    if case == "gain":
        name = _name(model, int(rng.integers(model.nactuator)), "actuator")
        factor = float(1.0 - strength * rng.uniform(0.2, 0.4))
        return Hidden(_truth("actuator.gain", "actuator", name, {"factor": factor}))
    if case == "delay":
        late = max(1, round(rng.uniform(0.01, 0.02) / robot.step))
        sole = (("actuator", _name(model, 0, "actuator")),) if model.nactuator == 1 else ()
        found = _truth("actuator.delay", "actuator", "all", {"delay": late * robot.step})
        return Hidden(replace(found, accept=sole), late)
    return Hidden()


def _payload(robot: Robot, rng: np.random.Generator, strength: float) -> HiddenEffect:
    """A load at the end of a longest chain of joints; tools are no part of it."""
    model, data = robot.model, mujoco.MjData(robot.model)
    depth = np.zeros(model.nbody, dtype=int)
    looped = set(model.eq_obj1id.tolist()) | set(model.eq_obj2id.tolist())
    for body in range(1, model.nbody):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        joints = set(range(first, first + count))
        hinged = any(model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE for i in joints - looped)
        # a finger on a slide or in a linkage is a tool's, not the end of the arm
        depth[body] = depth[model.body_parentid[body]] + count if hinged else 0
    body = int(rng.choice(np.flatnonzero(depth == depth.max())))
    data.qpos = robot.pose
    mujoco.mj_forward(model, data)
    lift = np.zeros((3, model.nv))
    mujoco.mj_jacBodyCom(model, data, lift, None, body)
    weight = np.abs(9.81 * lift[2])[robot.driven]
    spare = np.maximum(robot.limit - np.abs(robot.hold), 0.0)[robot.driven]
    held = np.min(spare / np.maximum(weight, 1e-9))
    mass = strength * rng.uniform(0.05, 0.3) * min(held, float(model.body_subtreemass[0]))
    away = rng.standard_normal(3)
    size = np.sqrt(model.body_inertia[body].sum() / 2.0 / model.body_mass[body])
    where = model.body_ipos[body] + size * away / np.linalg.norm(away)
    fixed = tuple(
        ("body", model.body(i).name)
        for i in range(model.nbody)
        if model.body_weldid[i] == model.body_weldid[body] and i != body
    )
    parameters = {"mass": float(mass), "position": tuple(float(x) for x in where)}
    found = _truth("body.payload_fixed", "body", model.body(body).name, parameters)
    return replace(found, accept=fixed)


def _truth(effect: str, kind: str, name: str, parameters: dict[str, Any]) -> HiddenEffect:
    return HiddenEffect(effect, kind, name, parameters, effect)


def _name(model: mujoco.MjModel, index: int, kind: str) -> str:
    return getattr(model, kind)(index).name or f"{kind}{index}"


def visible(robot: Robot, made: Sequence[Motion], case: str, seed: int) -> Hidden | None:
    """Draw what to hide until it shows; None if it never does."""
    rng = np.random.default_rng([seed, *f"{robot.path.stem}/{case}".encode()])
    usual = _positions(made[0].run(Hidden(), 0.0)[0])
    for strength in np.repeat([1.0, 2.0], DRAWS // 2):
        hidden = draw(robot, case, rng, float(strength))
        moved = _positions(made[0].run(hidden, 0.0)[0])
        shown = np.sqrt(np.mean((moved - usual) ** 2, axis=0)).max() > VISIBLE * NOISE
        stuck = np.ptp(moved, axis=0) < MOVED * np.ptp(usual, axis=0)
        if hidden.truth is None or (shown and not stuck[robot.driven].any()):
            return hidden
    return None


def _touching(data: mujoco.MjData) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in data.contact.geom[: data.ncon]}


def _positions(recording: Recording) -> Array:
    return np.column_stack([x for name, x in recording.columns.items() if name[:5] == "qpos/"])


def held(path: Path, scratch: Path) -> Path:
    """The model itself; with its free joints taken out if it has any."""
    spec = mujoco.MjSpec.from_file(str(path))
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        return path
    poses = mujoco.MjModel.from_xml_path(str(path)).key_qpos
    names = [key.name for key in spec.keys]
    for key in list(spec.keys):
        spec.delete(key)
    for joint in free:
        spec.delete(joint)
    for name, pose in zip(names, poses, strict=True):
        spec.add_key(name=name, qpos=pose[7 * len(free) :])
    spec.meshdir = str((path.parent / spec.meshdir).resolve())
    spec.texturedir = str((path.parent / spec.texturedir).resolve())
    spec.compile()
    kept = scratch / path.name
    kept.write_text(spec.to_xml())
    return kept
