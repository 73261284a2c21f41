"""Something that a machine runs into: a flat face that its outer links never pass.

While a link touches something, the force residual is far beyond what it is otherwise, and is that
of one force on the link (S. Haddadin, A. De Luca and A. Albu-Schäffer, Robot collisions, 2017). The
forces say which link it is and on which side; where the face stands and looks follows from the
link's own shape: it is as far as the face whenever it touches, and never beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares

from wt.physics.motion import Motion
from wt.physics.parts import add_geom
from wt.physics.scene import Scene

_SIZE, _OFTEN, _SELDOM = 10.0, 0.4, 0.002
"""A residual so many times its usual size is a hit, if that is so neither always nor never."""
_EXPLAINED, _ONE_SIDED = 0.5, 0.7
"""Share of these residuals that one force on a link explains; … that all of them push one way."""
_LOOKED_AT, _BESIDE = 80, 240  # samples of hits, and of all others
_MILLIMETRE = 1e-3
_WAYS, _TRIED = 120, 4
"""Number of directions tried for a face, and number of those that are refined."""
_NEAR, _TOUCHING = 20.0, 3.0
"""[mm] A hit so far from a face that looks about right, and from one in place, is another's: what
else moves the machine suddenly must not pull at the face."""
_AWAY, _FACE = 50.0, "a face in the way"  # m: nothing is behind a plane so far off


@dataclass(frozen=True)
class Face:
    """A flat face in the way.

    Attributes:
        position: where it is touched, (3,) [m].
        normal: out of it, towards the machine, (3,).
    """

    position: tuple[float, float, float]
    normal: tuple[float, float, float]


@lru_cache(maxsize=4)
def face(motion: Motion) -> Face | None:
    """The face that a fixed machine runs into, if any."""
    if motion.scene.free:
        return None
    residual = motion.residual - np.median(motion.residual, axis=0)
    scale = 1.4826 * np.median(np.abs(residual), axis=0) + 1e-9
    size = np.linalg.norm(residual / scale, axis=1)
    hit = size > _SIZE * np.median(size)
    if not _SELDOM < hit.mean() < _OFTEN:
        return None
    rows = _some(np.flatnonzero(hit), _LOOKED_AT)
    body, push = _pushed(motion, rows, residual[rows] / scale, scale)
    if not body:
        return None
    return _placed(motion, body, push, rows, _some(np.flatnonzero(~hit), _BESIDE))


def _some(rows: Int[np.ndarray, " row"], count: int) -> Int[np.ndarray, " some"]:
    return rows[:: max(1, len(rows) // count)]


def _pushed(
    motion: Motion,
    rows: Int[np.ndarray, " hit"],
    residual: Float[np.ndarray, "hit dof"],
    scale: Float[np.ndarray, " dof"],
) -> tuple[str, Float[np.ndarray, " 3"]]:
    """The body on which forces explain scaled residuals (n, nv) best, and where they push."""
    m, d, jacobian = motion.scene.model, motion.scene.data, np.zeros((3, motion.scene.model.nv))
    direction = ("", np.zeros(3))
    total, best = float((residual**2).sum()), _EXPLAINED
    for name in motion.scene.moving:
        body = m.body(name).id
        geoms = np.flatnonzero(m.geom_bodyid == body)
        for geom in geoms:
            forces, left = np.zeros((len(rows), 3)), 0.0
            for i, (k, r) in enumerate(zip(rows, residual, strict=True)):
                d.qpos[:] = motion.q[k]
                mujoco.mj_kinematics(m, d)
                mujoco.mj_comPos(m, d)
                mujoco.mj_jac(m, d, jacobian, None, d.geom_xpos[geom], body)
                scaled = (jacobian / scale).T
                forces[i], *_ = np.linalg.lstsq(scaled, r, rcond=1e-3)
                left += float(((r - scaled @ forces[i]) ** 2).sum())
            push = forces.sum(axis=0)
            one_sided = np.linalg.norm(push) > _ONE_SIDED * np.linalg.norm(forces, axis=1).sum()
            if left < best * total and one_sided:
                best, direction = left / total, (name, push / np.linalg.norm(push))
    return direction


def _placed(
    motion: Motion,
    body: str,
    push: Float[np.ndarray, " 3"],
    on: Int[np.ndarray, " hit"],
    off: Int[np.ndarray, " other"],
) -> Face | None:
    """The face that the outer links touch in hits and never pass else.

    Forces hardly say which way it looks: where on a link it touches decides as much.
    """
    fits = _Misfits(_FaceProbe(motion.scene, body), motion.q[on], motion.q[off])
    ways = [push, *_around()]
    rough = [(*fits.roughly(way), way) for way in ways]
    first = sorted((one for one in rough if np.isfinite(one[0])), key=lambda one: one[0])[:_TRIED]
    placed = [fits.placed(way, height) for _, height, way in first]
    if not placed:
        return None
    _, normal, height = min(placed, key=lambda one: one[0])
    centre = np.median(fits.probe.points(normal, motion.q[on]), axis=0)
    x, y, z = (float(c) for c in centre + (height - centre @ normal) * normal)
    a, b, c = (float(c) for c in normal)
    return Face((x, y, z), (a, b, c))


def _around() -> Float[np.ndarray, "way 3"]:
    """Directions all around, spread evenly, (n, 3) (E. B. Saff and A. Kuijlaars, 1997)."""
    k = np.arange(_WAYS)
    z = 1.0 - (2.0 * k + 1.0) / _WAYS
    turn = k * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


@dataclass(frozen=True, eq=False)
class _Misfits:
    """Distances by which faces miss being touched in all hits and passed in no other pose."""

    probe: _FaceProbe
    on: Float[np.ndarray, "hit dof"]
    off: Float[np.ndarray, "other dof"]

    def of(self, normal: Float[np.ndarray, " 3"], height: float) -> Float[np.ndarray, " pose"]:
        """The misfits of a face [mm]."""
        touching = self.probe.heights(normal, self.on) - height
        free = np.minimum(self.probe.heights(normal, self.off) - height, 0.0)
        share = np.sqrt(len(self.on) / len(self.off))
        return np.nan_to_num(np.concatenate([touching, share * free])) / _MILLIMETRE

    def roughly(self, normal: Float[np.ndarray, " 3"]) -> tuple[float, float]:
        """(misfit, height) of the best face that looks that way; endless where nothing touches."""
        on, off = self.probe.heights(normal, self.on), self.probe.heights(normal, self.off)
        heights = on[np.isfinite(on)]
        if not len(heights):
            return np.inf, np.nan
        near = _NEAR * _MILLIMETRE
        missed = np.minimum(np.abs(heights[:, None] - heights) / near, 1.0).mean(axis=1)
        passed = np.clip((heights[:, None] - off[np.isfinite(off)]) / near, 0.0, 1.0).mean(axis=1)
        misfits = missed + passed
        best = int(np.argmin(misfits))
        return float(misfits[best]), float(heights[best])

    def placed(
        self, way: Float[np.ndarray, " 3"], height: float
    ) -> tuple[float, Float[np.ndarray, " 3"], float]:
        """(misfit, normal, height) of the best face that looks about that way."""
        side = np.linalg.svd(way[None])[2][1:]

        def turned(x: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
            n = way + x[:2] @ side
            return np.asarray(n / np.linalg.norm(n))

        solution = least_squares(
            lambda x: self.of(turned(x), x[2]), [0.0, 0.0, height], loss="cauchy",
            f_scale=_TOUCHING, x_scale=[0.1, 0.1, 0.01], diff_step=[1e-3, 1e-3, 1e-4], max_nfev=30,
        )  # fmt: skip
        return float(solution.cost), turned(solution.x), float(solution.x[2])


class _FaceProbe:
    """Heights of a link and what it carries over planes through the origin."""

    def __init__(self, scene: Scene, body: str) -> None:
        spec = scene.spec()
        plane, size = mujoco.mjtGeom.mjGEOM_PLANE, [1.0, 1.0, 0.1]
        add_geom(spec, spec.worldbody, _FACE, type=plane, size=size, gap=2.0 * _AWAY)
        self._m = m = spec.compile()
        # what is fixed to a body is touched as it is, on whichever of both the force seems to act
        root = int(m.body(body).weldid[0])
        outer = np.array([_carries(m, root, b) for b in range(m.nbody)], dtype=int)
        # MuJoCo asks bodies first, and geoms then
        m.body_conaffinity[:], m.geom_conaffinity[:] = outer, outer[m.geom_bodyid]
        m.body_contype[:], m.geom_contype[:] = 0, 0
        m.body_contype[0], m.geom(_FACE).contype = 1, 1
        self._d = mujoco.MjData(self._m)
        self._plane = self._m.geom(_FACE).id
        m.geom_sameframe[self._plane] = 0  # it is moved, and no longer where the world's frame is

    def heights(
        self, normal: Float[np.ndarray, " 3"], q: Float[np.ndarray, "pose dof"]
    ) -> Float[np.ndarray, " pose"]:
        """Of the lowest point along a direction at each pose, (n,) [m]."""
        return np.array([height for height, _ in self._lowest(normal, q)])

    def points(
        self, normal: Float[np.ndarray, " 3"], q: Float[np.ndarray, "pose dof"]
    ) -> Float[np.ndarray, "pose 3"]:
        """These points, (n, 3) [m]."""
        return np.array([point for _, point in self._lowest(normal, q)])

    def _lowest(
        self, normal: Float[np.ndarray, " 3"], q: Float[np.ndarray, "pose dof"]
    ) -> list[tuple[float, Float[np.ndarray, " 3"]]]:
        m, d, lowest = self._m, self._d, []
        mujoco.mju_quatZ2Vec(m.geom_quat[self._plane], normal)
        m.geom_pos[self._plane] = -_AWAY * normal
        for pose in q:
            d.qpos[:] = pose
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            mujoco.mj_collision(m, d)
            distance = d.contact.dist
            if not len(distance):
                lowest.append((np.nan, np.full(3, np.nan)))
                continue
            nearest = int(np.argmin(distance))
            point = d.contact.pos[nearest] + 0.5 * distance[nearest] * normal
            lowest.append((float(point @ normal), np.array(point)))
        return lowest


def _carries(model: mujoco.MjModel, body: int, other: int) -> bool:
    """Tell whether a body moves another one along, or is it."""
    while other > body:
        other = int(model.body_parentid[other])
    return other == body
