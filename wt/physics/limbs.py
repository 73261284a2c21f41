"""Limbs: what hangs on something that does not move, and moves apart from everything else.

The legs of a robot whose trunk is held, the fingers of a hand: what is missing in one changes the
motion of no other. Each is replayed by itself, and only where a hypothesis has something else there
than another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import mujoco
import numpy as np
from jaxtyping import Int

from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.scene import Scene

_NEAR_M = 0.02  # limbs that come so near to each other may touch in a replay
_LOOKED_AT = 200  # samples of a motion, for whether they do
_STATIC = -1  # MuJoCo's tree of what does not move


@dataclass(frozen=True, eq=False)
class Limb:
    """One limb of a machine.

    Attributes:
        scene: it alone, with what does not move.
        dofs: its degrees of freedom among the machine's.
        actuators: its actuators among the machine's.
    """

    scene: Scene
    dofs: Int[np.ndarray, " own"]
    actuators: Int[np.ndarray, " own_actuator"]

    def stretch(self, stretch: Stretch) -> Stretch:
        """What it did in a stretch."""
        acted, motion = stretch.activation, stretch.motion
        return replace(
            stretch,
            command=stretch.command[:, self.actuators],
            q0=stretch.q0[self.dofs],
            v0=stretch.v0[self.dofs],
            activation=None if acted is None else acted[self.actuators],
            lead=stretch.lead[:, self.actuators] if len(stretch.lead) else stretch.lead,
            motion=None if motion is None else self.motion(motion),
        )

    @lru_cache(maxsize=64)  # noqa: B019 – lives and dies with a diagnosis
    def motion(self, motion: Motion) -> Motion:
        """What it did in all recordings."""
        own = {name: getattr(motion, name)[:, self.dofs] for name in ("q", "v", "a")}
        return Motion(
            self.scene, motion.segments, motion.t, **own, command=motion.command[:, self.actuators]
        )


class Limbs:
    """All limbs of a machine, and which of them effects act on."""

    def __init__(self, scene: Scene) -> None:
        """Take a machine apart whose limbs are independent; see :func:`limbs`."""
        m = self._model = scene.model
        joints = m.dof_treeid
        drives = joints[m.jnt_dofadr[m.actuator_trnid[:, 0]]]
        names = np.array([m.body(i).name for i in range(m.nbody)])
        each = []
        for k in range(m.ntree):
            others = names[(m.body_treeid != k) & (m.body_treeid != _STATIC)].tolist()
            alone = Scene(scene.path, [*scene.amendments, partial(_without, bodies=others)])
            each.append(Limb(alone, np.flatnonzero(joints == k), np.flatnonzero(drives == k)))
        self.each = tuple(each)
        self._known: dict[tuple[str, str], Sequence[int] | None] = {}

    def on(self, hypothesis: Sequence[Planted]) -> list[tuple[Planted, ...]] | None:
        """What of a hypothesis acts on each limb; None where something couples them."""
        parts: list[list[Planted]] = [[] for _ in self.each]
        for p in hypothesis:
            acted_on = self._of(p)
            if acted_on is None:
                return None
            for k in acted_on:
                parts[k].append(p)
        return [tuple(part) for part in parts]

    def together(self, hypothesis: Sequence[Planted], some: Sequence[int]) -> list[int]:
        """Parts of a hypothesis on the limbs that some of them act on; all where any couples limbs.

        Args:
            hypothesis: effects.
            some: indices of the parts.
        """
        known = [self._of(p) for p in hypothesis]
        each = [acted_on for acted_on in known if acted_on is not None]
        if len(each) < len(known):
            return list(range(len(known)))
        limbs_of_some = {k for i in some for k in each[i]}
        return [i for i, own in enumerate(each) if not limbs_of_some.isdisjoint(own)]

    def _of(self, planted: Planted) -> Sequence[int] | None:
        """The limbs that an effect acts on, each for itself; None if it might couple some."""
        if planted.effect.id not in effects():  # a learned law may depend on anything
            return None
        there = planted.at.kind, planted.at.name
        if there not in self._known:
            self._known[there] = self._at(*there)
        return self._known[there]

    def _at(self, kind: str, name: str) -> Sequence[int] | None:
        """The limbs at a place; None if it is on none of them, or on several."""
        m = self._model
        if name == "all" or kind == "world":
            return range(len(self.each))
        if kind in ("joint", "pair"):
            dofs = [m.joint(joint).dofadr[0] for joint in name.split("+")]
            trees = {int(m.dof_treeid[dof]) for dof in dofs}
        elif kind == "actuator":
            trees = {int(m.dof_treeid[m.jnt_dofadr[m.actuator(name).trnid[0]]])}
        elif kind == "body":
            trees = {int(m.body_treeid[m.body(name).id])}
        else:
            return None
        return None if len(trees) > 1 or _STATIC in trees else list(trees)


@lru_cache(maxsize=8)
def limbs(scene: Scene, motion: Motion) -> Limbs | None:
    """The limbs of a machine; None if it has one only, or if they depend on each other.

    Args:
        scene: the machine.
        motion: in which they are not to come near each other.
    """
    m = scene.model
    of_joints = (m.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    coupled = scene.free or m.neq or m.ntendon or not of_joints or not _is_named(m)
    if m.ntree < 2 or coupled or _touch(m, motion):
        return None
    return Limbs(scene)


def _is_named(m: mujoco.MjModel) -> bool:
    """Tell whether what moves can be told by names."""
    return all(m.body(int(i)).name for i in np.flatnonzero(m.body_treeid != _STATIC))


def _touch(model: mujoco.MjModel, motion: Motion) -> bool:
    """Tell whether limbs come so near to each other that they may touch."""
    m = mujoco.MjModel.__copy__(model)
    m.geom_margin[:] = np.maximum(m.geom_margin, _NEAR_M)
    m.pair_margin[:] = np.maximum(m.pair_margin, _NEAR_M)
    d, tree = mujoco.MjData(m), m.body_treeid[m.geom_bodyid]
    for k in np.unique(np.linspace(0, len(motion) - 1, _LOOKED_AT).astype(int)):
        d.qpos[:] = motion.q[k]
        mujoco.mj_kinematics(m, d)
        mujoco.mj_collision(m, d)
        pairs = tree[d.contact.geom[: d.ncon]]
        apart = (pairs[:, 0] != pairs[:, 1]) & (pairs != _STATIC).all(axis=1)
        if apart.any():
            return True
    return False


def _without(spec: mujoco.MjSpec, bodies: Sequence[str]) -> None:
    """Take bodies out of an MJCF, with all that refers to them."""
    for key in list(spec.keys):
        spec.delete(key)
    for root in [name for name in bodies if spec.body(name).parent.name not in bodies]:
        spec.delete(spec.body(root))
