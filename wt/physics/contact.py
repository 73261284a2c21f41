"""Forces of contacts are not known; what they cannot explain of a force residual is.

Which parts carry load is not recorded. Wherever a part of the machine may touch something fixed, a
contact there could supply any force along the Jacobian of the point that touches. The *free* part
of a generalised force is what is left beside all of these: its projection along them, orthogonal
in the metric of the inverse inertia (M. Mistry and L. Righetti, Operational space control of
constrained and underactuated systems, 2011). To take a foot for touching that does not only loses
what it would have told.

Equality constraints, as of a gripper whose fingers are coupled, hold with forces that are not known
either: their Jacobians are taken out in the same way.

What the contacts do supply says who carries load, and how slippery it is (:class:`ContactLoad`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from wt.physics.ground import Floor
from wt.physics.reach import reaching
from wt.physics.scene import Scene
from wt.types import Location

NEAR = 0.02
"""Parts closer than this [m] may touch: tracked positions, slopes and soft ground are off by it."""
_RIDGE = 1e-6
_UNFELT = 1e-9  # m/rad, or of a slide's way


@dataclass(frozen=True, eq=False)
class ContactLoad:
    """Loads that the contacts of one sample carry, C of them.

    Attributes:
        geoms: the two geoms of each, (C, 2).
        force: what the residual says acts on the second geom, (C, 3) [N]: along the contact's
            normal, which points to that geom, and across it.
        slip: velocity of the second geom's point over the first's, (C, 2) [m/s], across the normal.
    """

    geoms: Int[np.ndarray, "contact 2"]
    force: Float[np.ndarray, "contact 3"]
    slip: Float[np.ndarray, "contact 2"]


@dataclass(frozen=True, eq=False)
class Touching:
    """Samples and directions in which contact may have acted on a machine.

    Attributes:
        projector: takes a generalised force to its free part, (T, nv, nv); None if nothing ever
            comes near anything, and no joints are coupled.
        near: how many contacts are possible at each sample, (T,).
    """

    projector: Float[np.ndarray, "sample dof dof"] | None
    near: Int[np.ndarray, " sample"]

    def free(
        self, force: Float[np.ndarray, "sample dof *column"]
    ) -> Float[np.ndarray, "sample dof *column"]:
        """The part of a generalised force that no contact supplies; (T, nv) or (T, nv, k)."""
        if self.projector is None:
            return force
        if force.ndim == 2:
            return np.asarray((self.projector @ force[:, :, None])[:, :, 0])
        return np.asarray(self.projector @ force)


def touching(
    scene: Scene, q: Float[np.ndarray, "sample dof"], floors: Sequence[Floor] = ()
) -> Touching:
    """Find where contact may act on a machine at positions ``q`` (T, nv), floors where they are.

    One with a fixed base is taken to touch nothing: its parts are close to much all the time.
    """
    coupled = bool(scene.model.eq_active0.any())
    if not scene.free and not coupled:
        return Touching(None, np.zeros(len(q), dtype=int))
    probe = _ContactProbe(scene, floors)
    near, projector = np.zeros(len(q), dtype=int), np.zeros((len(q), *2 * (scene.model.nv,)))
    projector[:] = np.eye(scene.model.nv)
    for k, pose in enumerate(q):
        probe.put(pose)
        rows = probe.couplings()
        if scene.free:
            _, jacobian = probe.contacts()
            near[k] = len(jacobian) // 3
            rows = np.vstack([jacobian, rows])
        if len(rows):
            projector[k] -= rows.T @ probe.carried(rows)
    return Touching(projector if coupled or near.any() else None, near)


def loads(
    scene: Scene,
    q: Float[np.ndarray, "sample dof"],
    v: Float[np.ndarray, "sample dof"],
    residual: Float[np.ndarray, "sample dof"],
    floors: Sequence[Floor] = (),
) -> list[ContactLoad]:
    """Loads of the possible contacts at some samples, one after another.

    Args:
        scene: the machine.
        q: positions, (n, nv).
        v: velocities, (n, nv).
        residual: inverse dynamics minus the force of the drives, (n, nv).
        floors: planes that are elsewhere than the model says.
    """
    probe, contact_loads = _ContactProbe(scene, floors), []
    for pose, speed, force in zip(q, v, residual, strict=True):
        probe.put(pose)
        geoms, jacobian = probe.contacts()
        if len(geoms):
            carried = (probe.carried(jacobian) @ force).reshape(-1, 3)
            contact_loads.append(
                ContactLoad(geoms, carried, (jacobian @ speed).reshape(-1, 3)[:, 1:])
            )
    return contact_loads


def fixed(model: mujoco.MjModel) -> Bool[np.ndarray, " geom"]:
    """Mask of the geoms that never move."""
    return np.asarray(model.body_weldid[model.geom_bodyid] == 0)


def pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Geoms that may touch of which one is fixed: (fixed, moving)."""
    still = fixed(model)
    kind, likes = model.geom_contype, model.geom_conaffinity
    return [
        (int(a), int(b))
        for a in np.flatnonzero(still)
        for b in np.flatnonzero(~still)
        if kind[a] & likes[b] or kind[b] & likes[a]
    ]


def touchable(scene: Scene) -> list[Location]:
    """Named geoms that may touch: of the machine, and fixed ones."""
    geoms = {g for pair in pairs(scene.model) for g in pair}
    names = [scene.model.geom(g).name for g in sorted(geoms)]
    return [Location("geom", name) for name in names if name]


def partners(model: mujoco.MjModel, geom: int) -> list[int]:
    """Geoms that one may touch, where one of both is fixed."""
    return [b if a == geom else a for a, b in pairs(model) if geom in (a, b)]


def deciding(model: mujoco.MjModel, geom: int) -> list[int]:
    """Geoms whose parameters hold in a geom's contacts: of two the one of higher priority.

    Of equals it is the given one, or the one with more friction.
    """
    decisive = []
    for other in partners(model, geom):
        over = int(model.geom_priority[other] - model.geom_priority[geom])
        rougher = model.geom_friction[other, 0] > model.geom_friction[geom, 0]
        decisive.append(other if over > 0 or (over == 0 and rougher) else geom)
    return decisive


def unlike(value: float, others: Float[np.ndarray, " other"], share: float) -> bool:
    """Tell whether a value is further, in logarithms, than ``share`` from all others."""
    return bool((np.abs(np.log(value / np.maximum(others, 1e-6))) > share).all())


def outrank(geom: mujoco.MjsGeom, other: mujoco.MjsGeom) -> None:
    """Let a geom's parameters hold against another's."""
    geom.priority, geom.condim = other.priority + 1, max(geom.condim, other.condim)


class _ContactProbe:
    """Looks for contacts within reach."""

    def __init__(self, scene: Scene, floors: Sequence[Floor]) -> None:
        self._model = reaching(scene.model, NEAR)
        for floor in floors:
            floor.move(self._model)
        self._model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self._data = mujoco.MjData(self._model)
        self._fixed = fixed(self._model)

    def put(self, pose: Float[np.ndarray, " dof"]) -> None:
        """Take a pose, which all that follows is of."""
        self._data.qpos[:] = pose
        mujoco.mj_fwdPosition(self._model, self._data)

    def contacts(self) -> tuple[Int[np.ndarray, "contact 2"], Float[np.ndarray, "row dof"]]:
        """The pairs of geoms that may touch, (C, 2), and Jacobians of their points, (3C, nv)."""
        m, d = self._model, self._data
        # parts of the machine are close to each other always, and hardly ever touch
        touching = [c for c in d.contact if self._fixed[c.geom].any()]
        rows, one = np.zeros((len(touching), 3, m.nv)), np.zeros((3, m.nv))
        for jacobian, contact in zip(rows, touching, strict=True):
            for sign, geom in zip((-1.0, 1.0), contact.geom, strict=True):
                mujoco.mj_jac(m, d, one, None, contact.pos, m.geom_bodyid[geom])
                jacobian += sign * contact.frame.reshape(3, 3) @ one
        # what no joint moves, such as a point on a turret's axis, pushes at none either
        felt = np.abs(rows).max(axis=(1, 2), initial=0.0) > _UNFELT
        geoms = np.array([c.geom for c in touching], dtype=int).reshape(-1, 2)
        return geoms[felt], rows[felt].reshape(-1, m.nv)

    def couplings(self) -> Float[np.ndarray, "row dof"]:
        """Jacobian of the equality constraints, (R, nv)."""
        d = self._data
        rows = d.efc_J.reshape(-1, self._model.nv)
        return rows[d.efc_type[: len(rows)] == mujoco.mjtConstraint.mjCNSTR_EQUALITY]

    def carried(self, jacobian: Float[np.ndarray, "row dof"]) -> Float[np.ndarray, "row dof"]:
        """Contact forces per generalised force, (3C, nv): (J M⁻¹ Jᵀ)⁺ J M⁻¹."""
        inertia = np.zeros(2 * (self._model.nv,))
        mujoco.mj_fullM(self._model, self._data, inertia)
        lighter = np.linalg.solve(inertia, jacobian.T)
        apparent = jacobian @ lighter
        size = _RIDGE * np.trace(apparent) / len(apparent) * np.eye(len(apparent))
        return np.asarray(np.linalg.solve(apparent + size, lighter.T))
