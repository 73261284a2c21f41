"""One replay: a stretch of a recording on the model of a hypothesis, and how it begins."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.physics.acting import any_live
from wt.physics.activation import activated, dynamic
from wt.physics.hooks import OnInputs, OnOutputs, Stateful
from wt.physics.planted import Planted, in_order
from wt.physics.replay import Inputs, Outputs, Stretch
from wt.physics.scene import Scene


class Patched:
    """A hypothesis and its model, and what of it acts beside that: sorted once for all stretches.

    Attributes:
        scene: the machine.
        hypothesis: what is changed in it.
        model: of the hypothesis.
        driving: effects that change inputs, in the order in which a command passes them.
        sensing: those that change what sensors report.
        begins: those that say how joints begin that they add.
        live: whether a law acts at every step.
        sizes: of the model.
    """

    def __init__(self, scene: Scene, hypothesis: Sequence[Planted], model: mujoco.MjModel) -> None:
        """Sort a hypothesis, with its model."""
        self.scene, self.hypothesis, self.model = scene, tuple(hypothesis), model
        self.driving = [p for p in in_order(hypothesis) if isinstance(p.effect, OnInputs)]
        self.sensing = [p for p in hypothesis if isinstance(p.effect, OnOutputs)]
        self.begins = [p for p in hypothesis if isinstance(p.effect, Stateful)]
        self.live = any_live(hypothesis)
        self.sizes = sizes_of(model)

    def initial(
        self, stretch: Stretch
    ) -> tuple[Float[np.ndarray, " joint"], Float[np.ndarray, " joint"]]:
        """Positions and velocities to start from, in the order of the model's joints."""
        if not self.sensing and not self.begins:
            return stretch.q0[self._dofs], stretch.v0[self._dofs]
        known = initial_states(self.scene, self.hypothesis, stretch)
        states = np.array([known[name] for name in self._joints])
        return states[:, 0], states[:, 1]

    @functools.cached_property
    def _joints(self) -> tuple[str, ...]:
        """The model's joints."""
        return tuple(self.model.joint(i).name for i in range(self.model.njnt))

    @functools.cached_property
    def _dofs(self) -> Int[np.ndarray, " joint"]:
        """The machine's degree of freedom of each of these, where they are no more than its own."""
        return np.array([self.scene.dof(name) for name in self._joints], dtype=int)


def initial_states(
    scene: Scene, hypothesis: Sequence[Planted], stretch: Stretch
) -> dict[str, tuple[float, float]]:
    """Positions and velocities that a replay starts from, by joint, those that are added last."""
    start = Outputs(stretch.recording, stretch.t[:1], stretch.q0[None], stretch.v0[None])
    sensed = Outputs(start.recording, start.t, start.q.copy(), start.v.copy())
    for p in hypothesis:
        p.sense(sensed, scene)
    # what was measured is what the sensors made of it: undo an offset or a scale
    q, v = 2.0 * start.q[0] - sensed.q[0], 2.0 * start.v[0] - sensed.v[0]
    dofs = [(name, scene.dof(name)) for name in scene.joints]
    known = {name: (float(q[dof]), float(v[dof])) for name, dof in dofs}
    begun = replace(stretch, q0=q, v0=v)
    for p in hypothesis:
        known |= {name: known[leader] for name, leader in p.followers().items()}
        for name, hidden in p.started(begun).items():
            dq, dv = stretch.shifts.get(name, (0.0, 0.0))
            known[name] = (hidden.position + dq, hidden.velocity + dv)
    return known


def begun(model: mujoco.MjModel, stretch: Stretch) -> Float[np.ndarray, " actuator"]:
    """What each drive of a model acts on where a stretch begins."""
    if stretch.activation is not None:
        return stretch.activation
    return activated(model, stretch.t[:1], stretch.command[:1])[0]


BEND = " bend"
"""What the name of a tendon that yields is followed by, where its bend is meant."""


def activation(model: mujoco.MjModel, name: str) -> int:
    """Index of the activation ``<actuator> goal`` or ``<actuator> integral`` of a ``pid``."""
    actuator, _, what = name.rpartition(" ")
    of = model.actuator(actuator)
    return int(of.actadr[0] + (of.actnum[0] - 1 if what == "integral" else 0))


class Job:
    """One stretch on one hypothesis.

    Attributes:
        scene: the machine.
        patched: the hypothesis.
        stretch: what to replay.
        model: of the hypothesis.
        inputs: at every physics step.
        layout: what jobs share that can run side by side.
    """

    def __init__(self, patched: Patched, stretch: Stretch, given: Inputs) -> None:
        """Prepare.

        Args:
            patched: the hypothesis.
            stretch: what to replay.
            given: its inputs before any effect changes them.
        """
        self.scene, self.model = patched.scene, patched.model
        self.patched, self.stretch = patched, stretch
        if patched.driving:
            given = replace(given, u=given.u.copy(), force={}, torque={})
        for p in patched.driving:
            p.drive(given, self.scene)
        self.inputs = given.of_replay()
        pushed = bool(self.inputs.force), bool(self.inputs.torque)
        self.layout = (*patched.sizes, len(self.inputs.t), *pushed, patched.live)

    @functools.cached_property
    def own(self) -> Int[np.ndarray, " dof"]:
        """Addresses of the machine's joints in qpos and qvel of the patched model."""
        return np.array([self.model.joint(name).dofadr[0] for name in self.scene.joints])

    @functools.cached_property
    def sides(self) -> Int[np.ndarray, " side"]:
        """:attr:`own`, and behind them their drives' sides: a rotor, where the patch gave one."""
        motors = self.own.copy()
        for drive in self.scene.drives:
            joint = self.model.actuator(drive.name).trnid[0]
            motors[drive.dof] = self.model.jnt_dofadr[joint]
        return np.concatenate([self.own, motors])

    @functools.cached_property
    def controls(self) -> Int[np.ndarray, " control"]:
        """For each control of the patched model the index of the user's actuator it belongs to."""
        m, given = self.model, self.scene.model
        names = [
            m.actuator(i).name
            for i in range(m.actuator_trnid.shape[0])
            for _ in range(m.actuator_ctrlnum[i])
        ]
        return np.array([given.actuator(name).id for name in names], dtype=int)

    def wrenches(self, piece: slice) -> Float[np.ndarray, "step wrench"]:
        """World-frame forces and torques on all bodies in some steps, (steps, 6 · nbody)."""
        wrenches = np.zeros((piece.stop - piece.start, self.model.nbody, 6))
        for body, force in self.inputs.force.items():
            name = self.scene.model.body(body).name
            wrenches[:, self.model.body(name).id, :3] = force[piece]
        return wrenches.reshape(len(wrenches), -1)

    def torques(self, piece: slice) -> Float[np.ndarray, "step dof"]:
        """Generalised forces on all degrees of freedom of the patched model, (steps, nv)."""
        torques = np.zeros((piece.stop - piece.start, self.model.nv))
        for dof, torque in self.inputs.torque.items():
            name = self.scene.model.joint(int(self.scene.model.dof_jntid[dof])).name
            torques[:, self.model.joint(name).dofadr[0]] = torque[piece]
        return torques

    @functools.cached_property
    def _remembered(self) -> dict[str, float]:
        """What the patched model begins with that comes of all that was before, by name."""
        parts = [p.remembered(self.stretch) for p in self.patched.hypothesis if p.in_model]
        return {name: x for part in parts for name, x in part.items()}

    def activations(self) -> Float[np.ndarray, " activation"]:
        """Activations to start from, in the order of the patched model's."""
        given, start = self.scene.model, begun(self.scene.model, self.stretch)
        act = np.zeros(self.model.na)
        for i in np.flatnonzero(dynamic(given)):
            act[self.model.actuator(given.actuator(i).name).actadr[0]] = start[i]
        for name, x in self._remembered.items():
            if not name.endswith(BEND):
                act[activation(self.model, name)] = x
        return act

    def bend(
        self, qpos: Float[np.ndarray, " joint"], plastic: Float[np.ndarray, " plastic"]
    ) -> None:
        """Bend the springs of tendons that yield as they are where the stretch begins, in place.

        Args:
            qpos: positions to start from.
            plastic: states of what yields, unbent.
        """
        m = self.model
        for name, x in self._remembered.items():
            if name.endswith(BEND):
                tendon = m.tendon(name.removesuffix(BEND)).id
                first = m.tendon_adr[tendon]
                along = slice(first, first + m.tendon_num[tendon])
                length = m.wrap_prm[along] @ qpos[m.jnt_qposadr[m.wrap_objid[along]]]
                at = m.tendon_plasticadr[tendon]
                plastic[at : at + 2] = length - x


@functools.cache
def _size_names() -> tuple[str, ...]:
    """MjModel's integer sizes, apart from those of texts and names."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    names = [name for name in dir(model) if name.startswith("n") and "name" not in name]
    skip = {"nbuffer", "npaths", "ntextdata", "narena", "nconmax", "njmax"}
    return tuple(n for n in names if n not in skip and isinstance(getattr(model, n), int))


def sizes_of(model: mujoco.MjModel) -> tuple[int, ...]:
    """Sizes that two models must share to be simulated in one batch."""
    return tuple(getattr(model, name) for name in _size_names())
