"""A load that moves inside a body: where it was, and what it did to the body.

The load is a point at r = centre + s in the body's frame; s is free along some of its axes, between
stops. Along each of them (J. Wittenburg, Dynamics of Multibody Systems, 2008, section 2.2)

    (1 + rolling) s̈ = [g − a₀ − ω̇ × r − ω × (ω × r) − 2 ω × ṡ] − damping ṡ − spring s

with a₀ the acceleration of the frame's origin. A ball that rolls has ``rolling`` 2/5, a liquid's
first mode swings at √spring. The stops swallow what hits them. So a recording of the body alone
says where the load was at all times, if the law is given: what hits a stop has forgotten how it
began.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.physics.inertia import Moved, kinematics, reach
from wt.physics.motion import Motion, Segment

Centre = tuple[float, float, float]
"""Middle of a load's travel in the body's frame [m]."""

_STEP_S = 0.0025
"""Of the integration [s]: stops are reached at below 1 m/s."""
_LEAD_S = 3.0
"""Time in which a load forgets how it began [s]."""


@dataclass(frozen=True)
class LooseLaw:
    """Law by which a load moves; hashable, so that a path is computed once.

    Attributes:
        travel: along x, y and z of the body, from stop to stop [m]; 0 where it cannot.
        damping: per mass [1/s].
        spring: per mass [1/s²].
        rolling: share of its mass that its rotation adds.
    """

    travel: tuple[float, float, float]
    damping: float
    spring: float
    rolling: float


@dataclass(frozen=True, eq=False)
class Path:
    """Path of a load in the body's frame, at all samples of a motion.

    Attributes:
        s: away from its centre, (T, 3) [m].
        v: (T, 3) [m/s].
        a: mean acceleration around the sample, (T, 3) [m/s²].
    """

    s: Float[np.ndarray, "sample 3"]
    v: Float[np.ndarray, "sample 3"]
    a: Float[np.ndarray, "sample 3"]


def path_of(motion: Motion, body: str, centre: Centre, law: LooseLaw) -> Path:
    """Path of a load of one law; the last few are kept, as replays ask for them again."""
    return _path_of(motion.recorded, body, centre, law)


@lru_cache(maxsize=32)
def _path_of(motion: Motion, body: str, centre: Centre, law: LooseLaw) -> Path:
    return paths(motion, body, [(law, centre)])[0]


def paths(
    motion: Motion, body: str, loads: Sequence[tuple[LooseLaw, Centre]], longest: float = np.inf
) -> list[Path]:
    """Paths of loads of several laws, each from rest in its middle at a segment's start.

    Args:
        motion: of the body.
        body: that they are in.
        loads: the law and the middle of each.
        longest: of segments that last longer [s], pieces are integrated side by side, each begun so
            early that where a load began is forgotten.
    """
    moved = kinematics(motion.recorded)[body]
    s, v, a = np.zeros((3, len(motion), len(loads), 3))
    groups: dict[int, list[_Piece]] = {}
    for segment in motion.segments:
        groups.setdefault(_parts(segment.dt), []).extend(_pieces(segment, longest))
    for parts, pieces in groups.items():
        for piece, path in zip(pieces, _integrated(moved, pieces, parts, loads), strict=True):
            rows = slice(piece.rows.start + piece.lead, piece.rows.stop)
            s[rows], v[rows] = path[:, piece.lead :]
    for segment in motion.segments:
        a[segment.rows] = np.gradient(v[segment.rows], segment.dt, axis=0)
    return [Path(s[:, k], v[:, k], a[:, k]) for k in range(len(loads))]


class _Piece(NamedTuple):
    """Samples of a segment that are integrated in a row.

    Attributes:
        rows: they.
        dt: between them [s].
        lead: so many are there for the load to forget how it began.
    """

    rows: slice
    dt: float
    lead: int


def _parts(dt: float) -> int:
    """Steps from one sample to the next."""
    return max(1, round(dt / _STEP_S))


def _pieces(segment: Segment, longest: float) -> list[_Piece]:
    """Pieces of a segment of about the same length, after the first with a lead."""
    rows, dt = segment.rows, segment.dt
    count = max(1, int(np.ceil((rows.stop - rows.start) * dt / longest)))
    ends = np.linspace(rows.start, rows.stop, count + 1).round().astype(int).tolist()
    leads = [min(round(_LEAD_S / dt), start - rows.start) for start in ends[:-1]]
    return [
        _Piece(slice(start - lead, end), dt, lead)
        for start, end, lead in zip(ends[:-1], ends[1:], leads, strict=True)
    ]


def _integrated(
    moved: Moved, pieces: Sequence[_Piece], parts: int, loads: Sequence[tuple[LooseLaw, Centre]]
) -> list[Float[np.ndarray, "2 row load 3"]]:
    """Positions and velocities of L loads at the samples of each piece, (2, n, L, 3)."""
    from wt.physics.loose_steps import stepped  # takes a second to import

    sizes = [p.rows.stop - p.rows.start for p in pieces]
    n = max(sizes)
    pulls = np.stack([_pulls(moved, p.rows, parts, n) for p in pieces], axis=1)
    h = np.array([p.dt / parts for p in pieces])
    centres = np.array([centre for _, centre in loads])
    half = 0.5 * np.array([law.travel for law, _ in loads])
    figures = np.array([[law.damping, law.spring, law.rolling] for law, _ in loads])
    path = np.zeros((len(pieces), 2, n, len(loads), 3))
    stepped(pulls, h, parts, centres, half, *figures.T, path)
    return [p[:, :size] for p, size in zip(path, sizes, strict=True)]


def _pulls(moved: Moved, rows: slice, parts: int, n: int) -> Float[np.ndarray, "step 7 3"]:
    """What accelerates a load, but for spring and damping, of (where it is, how fast, one).

    At all steps between n samples; where there are fewer, the last goes on.
    """
    at, fine = np.arange(rows.stop - rows.start), np.arange((n - 1) * parts) / parts
    spin, turning, lifting = (
        np.stack([np.interp(fine, at, x[rows, k]) for k in range(3)], axis=1)
        for x in (moved.spin, moved.turning, moved.lifting)
    )
    around = _cross(spin)
    linear = [-(_cross(turning) + around @ around), -2.0 * around, -lifting[:, :, None]]
    return np.concatenate(linear, axis=2).swapaxes(1, 2)


def columns(
    motion: Motion, body: str, centre: Centre, path: Path
) -> Float[np.ndarray, "sample dof 4"]:
    """Force of a load on the machine, (T, nv, 4): per kilogram, and per kg·m off its centre.

    The latter are the derivatives in the centre, the path staying as it is.
    """
    return np.asarray(reach(motion.recorded, body) @ wrenches(motion, body, centre, path))


def wrenches(
    motion: Motion, body: str, centre: Centre, path: Path
) -> Float[np.ndarray, "sample 6 4"]:
    """Force and torque at the origin of the body, in its frame, of each column, (T, 6, 4)."""
    moved, bend = kinematics(motion.recorded)[body], _bend(motion.recorded, body)
    arm = np.array(centre) + path.s
    relative = path.a + 2.0 * np.cross(moved.spin, path.v)
    force = -(moved.lifting + (bend @ arm[:, :, None])[:, :, 0] + relative)
    columns = np.empty((len(arm), 6, 4))
    columns[:, :3, 0], columns[:, 3:, 0] = force, np.cross(arm, force)
    for k, axis in enumerate(np.eye(3)):
        change = -bend[:, :, k]
        columns[:, :3, k + 1] = change
        columns[:, 3:, k + 1] = np.cross(axis, force) + np.cross(arm, change)
    return columns


@lru_cache(maxsize=8)
def _bend(motion: Motion, body: str) -> Float[np.ndarray, "sample 3 3"]:
    """Acceleration of a point, per metre of its arm, by the body's turning [1/s²]."""
    moved = kinematics(motion)[body]
    spin = _cross(moved.spin)
    return np.asarray(_cross(moved.turning) + spin @ spin)


def _cross(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Matrices of the cross products with vectors, (…, 3) → (…, 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
