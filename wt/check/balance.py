"""How much of the commands a model explains, given the motion.

The model's inverse dynamics say which command each drive would have needed for the motion that
was recorded. Friction, armature, a bias, a gain that is off and a late command are physics and may
adapt, each with the sign it must have; what then is left, as a share of the command's variance, is
what the model cannot explain. Exchanged columns, signs and units are undone on the same arrays, so
that thousands of them can be compared: the smoothing before is linear.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.check.fitting import Fit, adapted, of_position, soft_sign
from wt.check.signals import Signals
from wt.physics.motion import NOT_DEMANDED
from wt.physics.scene import Drive, Scene

GAINS = (0.12, 8.0)
"""Of the model's, over the drive's: a factor between is physics."""
LATEST_S = 0.08
"""A delay up to it is physics."""
_DRAG = 4.0  # of the damping by which a drive holds a speed, that may take some of it
_ROTOR = 30.0  # of the inertia that a joint feels
_UPSET = 2.0  # of a mean square force
_STILL = 1e-6
_BEYOND, _ENDS = 0.15, (0.02, 0.98)  # of a joint's range past its limits; of the time
_AT_STOP, _RESTS = 0.02, 0.5  # of a joint's range, from its end; share of the time spent there
_DIRECT = (int(mujoco.mjtDyn.mjDYN_NONE), int(mujoco.mjtDyn.mjDYN_FILTER),
           int(mujoco.mjtDyn.mjDYN_FILTEREXACT))  # fmt: skip


@dataclass(frozen=True)
class Edit:
    """A channel that is made of another one: ``factor · source + offset``.

    Attributes:
        group: positions of degrees of freedom, or commands of actuators.
        index: of the channel.
        source: index of the channel whose column holds it.
        factor: sign and unit.
        offset: in the channel's own unit.
    """

    group: Literal["q", "u"]
    index: int
    source: int
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Row:
    """A drive whose command is explained: the only one of its joint.

    Attributes:
        drive: the drive.
        scale: force on the joint per command.
    """

    drive: Drive
    scale: float


class Balance:
    """Commands against inverse dynamics.

    Attributes:
        scene: the model.
        signals: the recording.
        rows: the drives whose commands are explained; not those that an equality or a stop holds.
        dynamic: whether inverse dynamics are known; where something floats, or a position was not
            recorded, the drives' own laws have to do.
        idle: degrees of freedom that no drive moves: friction and rotors aside, a right motion
            demands no force there.
    """

    def __init__(self, scene: Scene, signals: Signals) -> None:
        """Choose the rows."""
        self.scene, self.signals = scene, signals
        self.dynamic = not scene.free and bool(signals.measured.all())
        m = scene.model
        joints = [d.joint for d in scene.drives]
        held = self._held()
        self.rows = tuple(
            Row(d, d.gear * d.gain)
            for d in scene.drives
            if d.gear * d.gain != 0.0
            and int(m.actuator_dyntype[d.index]) in _DIRECT
            and joints.count(d.joint) == 1
            and not held[d.dof]
            and not self._rests(d)
            and signals.measured[d.dof]
            and signals.commanded[d.index]
            and signals.u[:, d.index].std() > _STILL
            and (self.dynamic or d.servo)
        )
        self._model = free_of_forces(m)
        self._data = mujoco.MjData(self._model)
        self._demands: dict[tuple[Edit, ...], Float[np.ndarray, "row dof"]] = {}
        self._keys: dict[tuple[Edit, ...], tuple[int, ...]] = {}
        self._known: dict[tuple[object, ...], Fit] = {}
        self._felt = self._inertia()
        self._swept = np.quantile(signals.q, _ENDS, axis=0)
        self.idle = self._undriven(held) if self.dynamic else ()

    def on(self, signals: Signals) -> Balance:
        """The same motion under other commands."""
        other = copy.copy(self)
        other.signals, other._known = signals, {}
        return other

    def damped(self, factor: float) -> Balance:
        """The same by servos whose damping is so many times the model's."""
        other, rows = copy.copy(self), list[Row]()
        for row in self.rows:
            constant, stiffness, damping = row.drive.bias
            drive = replace(row.drive, bias=(constant, stiffness, factor * damping))
            rows.append(replace(row, drive=drive if row.drive.servo else row.drive))
        other.rows, other._known = tuple(rows), {}
        return other

    def undone(self, edits: Sequence[Edit]) -> Balance:
        """The same recording after edits."""
        (u, du), (q, v, a) = self._sent(edits), self._moved(edits)
        other = self.on(replace(self.signals, q=q, v=v, a=a, u=u, du=du))
        other._demands, other._keys, other._swept = {}, {}, np.quantile(q, _ENDS, axis=0)
        return other

    def joint(self, dof: int) -> str:
        """Name of the joint of a degree of freedom."""
        return self.scene.joints[dof]

    def unexplained(
        self, edits: Sequence[Edit] = (), lenient: bool = False, sprung: bool = False
    ) -> Float[np.ndarray, " row"]:
        """Share of each row's command that the model cannot explain; 0 … above 1.

        Args:
            edits: mix-ups of channels that are undone.
            lenient: whether a force that goes with the joint's position (a spring, another weight)
                may adapt too, and the joint have less damping than in the model.
            sprung: whether a spring in the joint of a torque drive may adapt too.
        """
        return np.array([fit.left / fit.sent for fit in self._fits(edits, lenient, sprung)])

    def unexplained_of(self, row: Row, edits: Sequence[Edit]) -> float:
        """The same of one row alone."""
        (fit,) = self._fits(edits, rows=(row,))
        return fit.left / fit.sent

    def unexplained_forces(
        self, edits: Sequence[Edit] = (), gains: tuple[float, float] = GAINS
    ) -> Float[np.ndarray, " row"]:
        """Share of what each drive adds to the position it holds that the model cannot explain.

        Beside :meth:`unexplained` it tells units that positions and commands share, or gains.

        Args:
            edits: mix-ups of channels that are undone.
            gains: of the model's over the drive's, between which each may adapt.
        """
        return np.array([f.left / max(f.forced, 1e-18) for f in self._fits(edits, gains=gains)])

    def beyond(self, edits: Sequence[Edit] = ()) -> int:
        """How many joints are far beyond the limits that the model gives them, after edits."""
        places = {e.index: e for e in edits if e.group == "q"}
        m, count = self.scene.model, 0
        for i in map(int, np.flatnonzero(m.jnt_limited[m.dof_jntid] & self.signals.measured)):
            (low, high), e = m.jnt_range[m.dof_jntid[i]], places.get(i, Edit("q", i, i))
            ends = e.factor * self._swept[:, e.source] + e.offset
            count += max(low - ends.min(), ends.max() - high) > _BEYOND * (high - low)
        return int(count)

    def misfit(self, edits: Sequence[Edit] = ()) -> float:
        """The same of all drives, as a mean logarithm."""
        return float(np.log(self.unexplained_forces(edits) + 1e-6).mean()) if self.rows else 0.0

    def gains(self, edits: Sequence[Edit] = ()) -> Float[np.ndarray, " row"]:
        """Gain of the model's over that of each drive which fits best, however far from one."""
        return np.array([fit.gain for fit in self._fits(edits, gains=(0.0, np.inf))])

    def late(self) -> Float[np.ndarray, " row"]:
        """Time that each drive takes to follow its command [s], beside what a joint may lack.

        Between 0 and :data:`LATEST_S`.
        """
        return np.array([fit.late for fit in self._fits((), lenient=True)])

    def plain(self) -> Float[np.ndarray, "row 2"]:
        """Each drive's gain, and the damping that it lacks, where nothing else may adapt.

        Gains as in :meth:`gains`, but nearer to what all drives share: dry friction, rotors and
        delays take a part of a gain that little else tells. Damping is at the model's gain
        [N·m·s/rad or N·s/m].
        """
        s, found = self.signals, []
        demand = self._demand(())
        for row in self.rows:
            i, drive = row.drive.dof, row.drive
            force = row.scale * np.clip(s.u[:, drive.index], *drive.commands)
            force += drive.gear**2 * (drive.bias[1] * s.q[:, i] + drive.bias[2] * s.v[:, i])
            columns = np.stack([demand[:, i], s.v[:, i], np.ones(len(force))], axis=1)
            found.append(np.linalg.lstsq(columns, force)[0][:2])
        return np.array(found).reshape(-1, 2)

    def upset(self, edits: Sequence[Edit], before: Sequence[Edit]) -> bool:
        """Tell whether edits put what no drive moves out of balance, compared with others."""
        return any(
            self._idle_left(i, edits) > _UPSET * self._idle_left(i, before) for i in self.idle
        )

    def unheld(self, i: int, edits: Sequence[Edit] = ()) -> float:
        """Share of the force of a joint's inertia that comes from nowhere, where none drives it."""
        force = self._felt[i] * self._moved(edits)[2][:, i]
        return self._idle_left(i, edits) / max(float(np.mean(force**2)), _STILL**4)

    def _idle_left(self, i: int, edits: Sequence[Edit]) -> float:
        """Mean square force that friction and a rotor leave to nobody."""
        _, v, a = self._moved(edits)
        columns = np.stack([soft_sign(v[:, i]), v[:, i], a[:, i]], axis=1)
        high = np.array([np.inf, np.inf, _ROTOR * self._felt[i]])
        return adapted(columns, -self._demand(edits)[:, i], np.zeros(3), high)[0]

    def _held(self) -> Bool[np.ndarray, " dof"]:
        """Degrees of freedom that an equality acts on, with forces that nobody recorded."""
        m = mujoco.MjModel.__copy__(self.scene.model)
        m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        data = mujoco.MjData(m)
        data.qpos[:] = self._pose(m)
        mujoco.mj_forward(m, data)
        slopes = data.efc_J.reshape(-1, m.nv)
        return np.asarray((slopes[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]).any(0))

    def _rests(self, drive: Drive) -> bool:
        """Tell whether a joint lies against a stop most of the time, which nobody commanded."""
        m, joint = self.scene.model, self.scene.model.joint(drive.joint).id
        if not m.jnt_limited[joint]:
            return False
        low, high = m.jnt_range[joint]
        q = self.signals.q[:, drive.dof]
        near = np.minimum(np.abs(q - low), np.abs(q - high)) < _AT_STOP * (high - low)
        return bool(near.mean() >= _RESTS)

    def _pose(self, model: mujoco.MjModel) -> Float[np.ndarray, " coordinate"]:
        """A pose of the recording; the model's own where that is not known."""
        return np.median(self.signals.q, axis=0) if self.dynamic else model.qpos0

    def _undriven(self, held: Bool[np.ndarray, " dof"]) -> tuple[int, ...]:
        """Degrees of freedom without a drive, and that no equality holds."""
        m = self.scene.model
        data = mujoco.MjData(m)
        data.qpos[:] = self._pose(m)
        mujoco.mj_forward(m, data)
        rows = zip(data.moment_rowadr, data.moment_rownnz, strict=True)
        driven = {int(i) for at, n in rows for i in data.moment_colind[at : at + n]}
        return tuple(i for i in range(m.nv) if i not in driven and not held[i])

    def _fits(
        self,
        edits: Sequence[Edit],
        lenient: bool = False,
        sprung: bool = False,
        gains: tuple[float, float] = GAINS,
        rows: Sequence[Row] | None = None,
    ) -> list[Fit]:
        rows = self.rows if rows is None else rows
        moved = tuple(e for e in edits if e.group == "q")
        demands = self._demand_keys(moved)

        def key(row: Row) -> tuple[object, ...]:
            # another finger's motion is nothing to a drive, nor is another drive's command
            own = {"q": row.drive.dof, "u": row.drive.index}
            mine = (e for e in edits if e.index == own[e.group])
            return (row, demands[row.drive.dof], *mine, lenient, sprung, gains)

        missing = [row for row in rows if key(row) not in self._known]
        if missing:
            (u, du), (q, v, a) = self._sent(edits), self._moved(edits)
            demand = self._demand(edits)
            for row in missing:
                fit = self._fit(row, q, v, a, u, du, demand, lenient, sprung, gains)
                self._known[key(row)] = fit
        return [self._known[key(row)] for row in rows]

    def _sent(self, edits: Sequence[Edit]) -> tuple[Float[np.ndarray, "row actuator"], ...]:
        """Commands and their slopes after edits."""
        s = self.signals
        u, du = s.u.copy(), s.du.copy()
        for e in edits:
            if e.group == "u":
                u[:, e.index] = e.factor * s.u[:, e.source] + e.offset
                du[:, e.index] = e.factor * s.du[:, e.source]
        return u, du

    def _moved(self, edits: Sequence[Edit]) -> tuple[Float[np.ndarray, "row dof"], ...]:
        """Positions, velocities and accelerations after edits."""
        s = self.signals
        q, v, a = s.q.copy(), s.v.copy(), s.a.copy()
        for e in edits:
            if e.group == "q":
                q[:, e.index] = e.factor * s.q[:, e.source] + e.offset
                v[:, e.index] = e.factor * s.v[:, e.source]
                a[:, e.index] = e.factor * s.a[:, e.source]
        return q, v, a

    def _demand(self, edits: Sequence[Edit]) -> Float[np.ndarray, "row dof"]:
        """Force that the model demands for the motion after edits."""
        moved = tuple(e for e in edits if e.group == "q")
        if moved not in self._demands:
            q, v, a = self._moved(moved)
            self._demands[moved] = self.inverse(q, v, a)
        return self._demands[moved]

    def _demand_keys(self, moved: tuple[Edit, ...]) -> tuple[int, ...]:
        """For each degree of freedom what tells its demanded force after edits from others."""
        if moved not in self._keys:
            self._keys[moved] = tuple(hash(x.tobytes()) for x in self._demand(moved).T)
        return self._keys[moved]

    def inverse(
        self,
        q: Float[np.ndarray, "row dof"],
        v: Float[np.ndarray, "row dof"],
        a: Float[np.ndarray, "row dof"],
    ) -> Float[np.ndarray, "row dof"]:
        """Force that the model demands for a motion; zero where it cannot be known."""
        result = np.zeros_like(q)
        if not self.dynamic:
            return result
        m, d = self._model, self._data
        for k in range(len(q)):
            d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]
            mujoco.mj_inverse(m, d)
            result[k] = d.qfrc_inverse
        return result

    def _inertia(self) -> Float[np.ndarray, " dof"]:
        m, d = self._model, self._data
        full = np.zeros((m.nv, m.nv))
        d.qpos[:] = self._pose(m)
        mujoco.mj_forward(m, d)
        mujoco.mj_fullM(m, d, full)
        return np.asarray(np.diag(full)).copy()

    def _fit(
        self,
        row: Row,
        q: Float[np.ndarray, "row dof"],
        v: Float[np.ndarray, "row dof"],
        a: Float[np.ndarray, "row dof"],
        u: Float[np.ndarray, "row actuator"],
        du: Float[np.ndarray, "row actuator"],
        demand: Float[np.ndarray, "row dof"],
        lenient: bool,
        sprung: bool,
        gains: tuple[float, float],
    ) -> Fit:
        drive, i = row.drive, row.drive.dof
        command = np.clip(u[:, drive.index], *drive.commands)
        _, stiffness, damping = drive.bias
        # gear · (gain · u + spring) = force, so u = force / (gear · gain) − spring / gain
        spring = -drive.gear * (stiffness * q[:, i] + damping * v[:, i]) / drive.gain
        speed, demanded = v[:, i], demand[:, i]
        if lenient:
            demanded = demanded - self._model.dof_damping[i] * speed
        columns = np.stack(
            [
                demanded / row.scale,
                soft_sign(speed) / row.scale,
                speed / row.scale,
                a[:, i] / row.scale,
                du[:, drive.index],
            ],
            axis=1,
        )
        low = np.array([gains[0] if self.dynamic else 0.0, 0.0, 0.0, 0.0, 0.0])
        # a drive that is told a speed keeps a part of it
        told = stiffness == 0.0 and damping < 0.0
        drag = _DRAG * abs(damping) * drive.gear**2 if told else np.inf
        high = np.array([gains[1], np.inf, drag, _ROTOR * self._felt[i], LATEST_S])
        if sprung and not drive.servo:  # it pulls to where it rests: a part of the free constant
            columns = np.column_stack([columns, q[:, i] / row.scale])
            low, high = np.append(low, 0.0), np.append(high, np.inf)
        free = of_position(q[:, i]) if lenient else None
        left, best = adapted(columns, command - spring, low, high, free)
        sent, forced = float(command.var()), float((command - spring).var())
        return Fit(left, max(sent, _STILL**2), forced, float(best[0]), float(best[4]))


def free_of_forces(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy whose inverse dynamics leave all to the commands.

    Without contacts, limits, couplings and actuators; gravity that drives carry by themselves is
    not theirs to be commanded.
    """
    copied = mujoco.MjModel.__copy__(model)
    copied.opt.disableflags |= NOT_DEMANDED
    copied.jnt_actgravcomp[:] = 0
    return copied
