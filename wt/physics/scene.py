"""A model as effects see it: its joints, drives, bodies, and their names."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.errors import ModelError
from wt.physics import base, source
from wt.physics.activation import dynamic
from wt.physics.lean import slim
from wt.types import Location

_DYNAMICS = tuple(
    int(kind)
    for kind in (
        mujoco.mjtDyn.mjDYN_NONE,
        mujoco.mjtDyn.mjDYN_FILTER,
        mujoco.mjtDyn.mjDYN_FILTEREXACT,
        mujoco.mjtDyn.mjDYN_INTEGRATOR,
        mujoco.mjtDyn.mjDYN_DCMOTOR,
    )
)
Amendment = Callable[[mujoco.MjSpec], None]
"""Changes a model."""
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_GIVE = "give a motor, position, velocity, intvelocity or filtered actuator"


@dataclass(frozen=True)
class Drive:
    """An actuator that acts on one joint with a force affine in command, position and velocity.

    Its force on the joint is ``gear · (gain · u + bias + bias_q · gear · q + bias_v · gear · v)``,
    with the command u and the force before the gear inside the model's ranges.

    Attributes:
        name: the actuator's name.
        index: its index among actuators, which is that of its command.
        joint: the joint's name.
        dof: the joint's degree of freedom.
        gear: transmission ratio.
        gain: force per command.
        bias: constant, per position and per velocity part of the force, (3,).
        commands: range that commands, or what the drive's own dynamics make of them, are clamped
            to.
        forces: range that forces before the gear are clamped to.
    """

    name: str
    index: int
    joint: str
    dof: int
    gear: float
    gain: float
    bias: tuple[float, float, float]
    commands: tuple[float, float] = (-np.inf, np.inf)
    forces: tuple[float, float] = (-np.inf, np.inf)

    def force(self, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Force on the joint [N·m or N] from its command, position and velocity, of one shape."""
        return np.asarray(self.gear * np.clip(self.unclamped(u, q, v), *self.forces))

    def unclamped(self, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The force before the gear and before its own clamp."""
        constant, stiffness, damping = self.bias
        spring = stiffness * self.gear * q + damping * self.gear * v
        return np.asarray(self.gain * np.clip(u, *self.commands) + constant + spring)

    def limited(self, most: float) -> Drive:
        """The same that gives no more than so much on its joint [N·m or N]."""
        low, high = np.clip(self.forces, -most / abs(self.gear), most / abs(self.gear))
        return replace(self, forces=(float(low), float(high)))

    @property
    def servo(self) -> bool:
        """Tell whether it holds a position: its force falls with the joint's position."""
        return self.bias[1] < 0.0

    @property
    def held_per_command(self) -> float:
        """Position of the joint that a servo holds, per command; 0 for other drives."""
        return self.gain / (abs(self.bias[1]) * self.gear) if self.servo else 0.0


def drives(m: mujoco.MjModel) -> tuple[Drive, ...]:
    """The actuators of a model that act on a hinge or slide by an affine law, in its order."""
    listed = []
    for i in range(m.nactuator):
        joint = int(m.actuator_trnid[i, 0])
        if m.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT or m.jnt_type[joint] not in _SCALAR:
            continue
        law = _affine(m, i)
        if law is None:
            continue
        gain, *bias = law
        listed.append(
            Drive(
                name=m.actuator(i).name,
                index=i,
                joint=m.joint(joint).name,
                dof=int(m.jnt_dofadr[joint]),
                gear=float(m.actuator_gear[i, 0]),
                gain=gain,
                bias=(bias[0], bias[1], bias[2]),
                commands=_acted_on(m, i),
                forces=_forces(m, i, joint),
            )
        )
    return tuple(listed)


def _affine(m: mujoco.MjModel, i: int) -> tuple[float, float, float, float] | None:
    """Force of an actuator per command, constant, per length and per velocity; None if not so."""
    if m.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED:
        if m.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE:
            return float(m.actuator_gainprm[i, 0]), 0.0, 0.0, 0.0
        if m.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE:
            constant, stiffness, damping = map(float, m.actuator_biasprm[i, :3])
            return float(m.actuator_gainprm[i, 0]), constant, stiffness, damping
    if m.actuator_ctrlnum[i] != 1 or m.actuator_gear[i, 0] == 0.0:
        return None
    # any other kind: what MuJoCo makes of it
    free = copy.copy(m)
    free.actuator_ctrllimited[i] = free.actuator_forcelimited[i] = False
    free.actuator_history[i] = 0
    data, joint = mujoco.MjData(free), m.actuator_trnid[i, 0]

    def force(u: float, length: float, velocity: float) -> float:
        gear = float(m.actuator_gear[i, 0])
        data.qpos[m.jnt_qposadr[joint]] = length / gear
        data.qvel[m.jnt_dofadr[joint]] = velocity / gear
        data.ctrl[m.actuator_ctrladr[i]] = u
        mujoco.mj_fwdPosition(free, data)
        mujoco.mj_fwdVelocity(free, data)
        mujoco.mj_fwdActuation(free, data)
        return float(data.actuator_force[i])

    constant = force(0.0, 0.0, 0.0)
    gain, stiffness, damping = (force(*axis) - constant for axis in np.eye(3))
    for u, q, v in ((0.7, -0.4, 0.9), (-0.8, 0.3, -0.6)):
        summed = gain * u + constant + stiffness * q + damping * v
        if not np.isclose(force(u, q, v), summed, rtol=1e-6, atol=1e-9) or gain == 0.0:
            return None
    return gain, constant, stiffness, damping


def _forces(m: mujoco.MjModel, i: int, joint: int) -> tuple[float, float]:
    """Range of an actuator's force: its own, and what its joint lets through."""
    low, high = _range(bool(m.actuator_forcelimited[i]), m.actuator_forcerange[i])
    gear = float(m.actuator_gear[i, 0])
    if m.jnt_actfrclimited[joint] and gear != 0.0:
        ends = np.sort(m.jnt_actfrcrange[joint] / gear)
        low, high = max(low, float(ends[0])), min(high, float(ends[1]))
    return low, high


def _acted_on(m: mujoco.MjModel, i: int) -> tuple[float, float]:
    if dynamic(m)[i]:  # of the command within its range
        return _range(bool(m.actuator_actlimited[i]), m.actuator_actrange[i])
    return _range(bool(m.actuator_ctrllimited[i]), m.actuator_ctrlrange[i])


def _range(limited: bool, ends: Float[np.ndarray, " 2"]) -> tuple[float, float]:
    return (float(ends[0]), float(ends[1])) if limited else (-np.inf, np.inf)


def _refuse_unknown(m: mujoco.MjModel, spec: mujoco.MjSpec, path: Path) -> None:
    """Refuse a machine whose state recordings cannot tell, or whose laws are not known here.

    Raises:
        ModelError: it is such a machine; the message names the element.
    """
    for i in range(m.njnt):
        if int(m.jnt_type[i]) not in _SCALAR:
            raise ModelError(
                f"joint '{m.joint(i).name}' of '{path}' is a ball; only machines of hinges, slides "
                "and free bases can be diagnosed yet: write it as three hinges in one body, or "
                "leave it out where it is rigid"
            )
    for actuator in spec.actuators:
        kind, plugin = int(m.actuator_dyntype[actuator.id]), actuator.plugin
        named = f"actuator '{actuator.name}' of '{path}'"
        if m.actuator_plugin[actuator.id] >= 0:
            raise ModelError(
                f"{named} is a plugin ({plugin.plugin_name or plugin.name}), whose law and state "
                f"are not known here; {_GIVE}"
            )
        if kind not in _DYNAMICS:
            raise ModelError(
                f"{named} has dynamics of its own "
                f"({mujoco.mjtDyn(kind).name.removeprefix('mjDYN_').lower()}), whose state no "
                f"recording tells; {_GIVE}"
            )
    for flex in spec.flexes:
        if m.flex_rigid[flex.id]:
            continue
        raise ModelError(
            f"flex '{flex.name}' of '{path}' is deformable, and no recording tells how its "
            'vertices move; leave it out, or make it rigid (<flexcomp rigid="true">)'
        )


class Scene:
    """A model of a machine as effects see it: all of its joints are hinges and slides.

    Attributes:
        path: the MJCF.
        amendments: changes of the model beyond what the file says.
        free: names of the free joints, each of which is six joints here (:mod:`wt.physics.base`).
        model: the compiled model.
        data: scratch space for computations on the model.
    """

    def __init__(self, path: str | Path, amendments: Sequence[Amendment] = ()) -> None:
        """Read and compile an MJCF.

        Args:
            path: the file.
            amendments: what to change in the model wherever it is used, e.g. after an audit.

        Raises:
            ModelError: the file is missing or does not compile, or has joints or actuators that
                cannot be compared with recordings yet.
        """
        self.path, self.amendments = Path(path), tuple(amendments)
        source.check(self.path)
        try:
            spec = self.written()
            self.free = base.expand(spec)
            self.model, doubts = source.compiled(spec)
        except (ValueError, mujoco.FatalError) as error:
            reason = (str(error).strip().splitlines() or ["no reason given"])[0]
            raise ModelError(f"model '{path}' does not compile: {reason}") from error
        if not 0.0 < float(self.model.opt.timestep) < np.inf:
            raise ModelError(
                f"model '{path}' has a time step of {self.model.opt.timestep:g} s; give <option "
                'timestep="0.002"/> or another one above zero'
            )
        self.data = mujoco.MjData(self.model)
        _refuse_unknown(self.model, spec, self.path)
        for doubt in doubts:
            warnings.warn(f"model '{path}': {doubt}", stacklevel=2)

    def written(self, amended: bool = True) -> mujoco.MjSpec:
        """A fresh editable copy of the model as it is written, with or without the amendments.

        Joints and actuators without a name have one by their ids.
        """
        spec = source.read(self.path)
        source.name_unnamed(spec)
        for amend in self.amendments if amended else ():
            amend(spec)
        return spec

    def spec(self) -> mujoco.MjSpec:
        """The same with its free joints taken apart and on-time commands, as it is replayed.

        Replays get commands as late as the drives do.
        """
        spec = self.written()
        base.expand(spec)
        for actuator in spec.actuators:
            actuator.delay, actuator.nsample = 0.0, 0
        return spec

    @cached_property
    def slim(self) -> mujoco.MjSpec:
        """:meth:`spec` without what no replay can tell; what is edited is a copy of it."""
        spec = self.spec()
        slim(spec)
        return spec

    @cached_property
    def given(self) -> mujoco.MjModel:
        """The model as it is written, compiled: what recordings name their columns after."""
        return source.compiled(self.written())[0]

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of their degrees of freedom."""
        return tuple(self.model.joint(i).name for i in range(self.model.njnt))

    @cached_property
    def own_joints(self) -> tuple[str, ...]:
        """Those of them that are parts of the machine, which may have friction, play, drives."""
        of_bases = {name for joint in self.free for name in base.names(joint)}
        return tuple(name for name in self.joints if name not in of_bases)

    def dof_at(self, at: Location) -> int:
        """Degree of freedom that a place acts on alone; −1 if several."""
        if at.kind == "joint":
            return self.dof(at.name)
        dofs = [drive.dof for drive in self.driven(at)]
        return dofs[0] if len(dofs) == 1 else -1

    def dofs_at(self, at: Location) -> frozenset[int]:
        """Degrees of freedom on which a force at a place acts: of a body, all that move it."""
        if at.kind != "body" or at.name == "all":
            alone = self.dof_at(at)
            return frozenset(range(self.model.nv) if alone < 0 else [alone])
        m, body, dofs = self.model, self.model.body(at.name).id, list[int]()
        while body:
            first = int(m.body_dofadr[body])
            dofs += range(first, first + int(m.body_dofnum[body]))
            body = int(m.body_parentid[body])
        return frozenset(dofs)

    def place(self, joint: str) -> Location:
        """Place that people call a degree of freedom by: a joint, or the body that floats."""
        if joint in self.own_joints:
            return Location("joint", joint)
        return Location("body", self.model.body(self.model.joint(joint).bodyid[0]).name)

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """The actuators that act on a joint, in the model's order."""
        return drives(self.model)

    @cached_property
    def beside_drives(self) -> mujoco.MjModel | None:
        """The model whose actuators do what is not a drive's law; None if they do no more.

        Actuators on tendons and sites, those whose law is not affine, and joints whose drives carry
        gravity by themselves (``actuatorgravcomp``).
        """
        m = self.model
        carried = bool(m.jnt_actgravcomp.any() and m.body_gravcomp.any())
        if len(self.drives) == m.nactuator and not carried:
            return None
        beside = copy.copy(m)
        beside.actuator_history[:] = 0
        silent = [d.index for d in self.drives]
        beside.actuator_gaintype[silent] = mujoco.mjtGain.mjGAIN_FIXED
        beside.actuator_biastype[silent] = mujoco.mjtBias.mjBIAS_NONE
        beside.actuator_gainprm[silent] = 0.0
        return beside

    def drive(self, name: str) -> Drive:
        """The drive of an actuator.

        Raises:
            KeyError: no actuator on a joint has that name.
        """
        for drive in self.drives:
            if drive.name == name:
                return drive
        raise KeyError(name)

    def limited(self, most: Mapping[str, float]) -> Scene:
        """The same machine whose drives of some names give no more than so much on their joints."""
        limited = copy.copy(self)
        limited.drives = tuple(
            drive.limited(most[drive.name]) if drive.name in most else drive
            for drive in self.drives
        )
        return limited

    def driven(self, at: Location) -> tuple[Drive, ...]:
        """The drives at a place: one, at ``all`` every one, and none where no drive stands."""
        if at.kind != "actuator":
            return ()
        return self.drives if at.name == "all" else (self.drive(at.name),)

    def dof(self, joint: str) -> int:
        """Degree of freedom of a joint."""
        return int(self.model.joint(joint).dofadr[0])

    @cached_property
    def moving(self) -> tuple[str, ...]:
        """Names of the bodies with mass that move when some joint does."""
        m = self.model
        return tuple(
            m.body(i).name
            for i in range(1, m.nbody)
            if m.body(i).name and m.body_mass[i] > 0.0 and self.carries(i).any()
        )

    def carries(self, body: int) -> Bool[np.ndarray, " dof"]:
        """Mask of the degrees of freedom that move a body."""
        m = self.model
        moved = np.zeros(m.nv, bool)
        while body > 0:
            start, count = m.body_dofadr[body], m.body_dofnum[body]
            moved[start : start + count] |= count > 0
            body = int(m.body_parentid[body])
        return moved
