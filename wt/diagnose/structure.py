"""Which part of a machine a force residual comes from, judged by how it spreads over the joints.

A fault of a joint or its drive shows on that joint only; a coupling of two joints on both, in a
fixed ratio; a force on a body shows on all joints
that carry it, in the proportions of Jᵀf; a wrong direction of gravity on all joints, with one
constant vector; a sensor's fault in replays but in no force.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wt.diagnose.leftover import Leftover
from wt.diagnose.screen import Screen
from wt.types import Location

Array = np.ndarray

_ACTIVE = 1.5  # rms in units of the noise floor from which a joint has a force residual
_ALONE = 0.9  # share of the energy that makes one joint the place
_EXPLAINS = 0.8  # adjusted R² from which a body or gravity is the place
_MANY = 4  # joints from which three components of a force do not explain just anything
_TOGETHER = 0.9  # share of the energy, and correlation, that make two joints a pair
_ROWS = 8  # neighbouring rows that share one force on a body


def places(screen: Screen, rest: Leftover, joints: Mapping[str, float]) -> dict[Location, float]:
    """Where an unexplained residual arises, with shares that sum to 1.

    Args:
        screen: the recordings.
        rest: what the findings leave.
        joints: joint → weight of its unexplained replay error.
    """
    scene = screen.motion.scene
    scaled = rest.left / screen.floor
    rms = np.sqrt(np.mean(scaled**2, axis=0))
    named = [scene.dof(j) for j in joints]
    active = [d for d in range(len(rms)) if rms[d] > _ACTIVE]
    if len(active) > 1 and float(rms.max() ** 2 / (rms[active] ** 2).sum()) < _ALONE:
        # with and without what the errors of any rig may have hidden of it
        for some in ((rest.left + rest.adapted) / screen.floor, scaled):
            whole = _pair(screen, some) or _whole(screen, some, len(active))
            if whole:
                return {whole: 1.0}
    # in no force: a sensor of that joint; otherwise the joint itself
    own = [d for d in named if d in active] or named
    weight: dict[Location, float] = {}
    for joint in (scene.joints[d] for d in own):
        at = scene.place(joint)
        weight[at] = weight.get(at, 0.0) + joints[joint]
    total = sum(weight.values())
    return {at: w / total for at, w in weight.items()}


def _pair(screen: Screen, scaled: Array) -> Location | None:
    """Two joints with forces in a fixed ratio, as a cable or a belt over both would have."""
    energy = (scaled**2).sum(axis=0)
    two = sorted(np.argsort(-energy)[:2])
    if energy[two].sum() < _TOGETHER * energy.sum():
        return None
    if abs(float(np.corrcoef(scaled[:, two].T)[0, 1])) < _TOGETHER:
        return None
    first, second = (screen.motion.scene.joints[d] for d in two)
    return Location("pair", f"{first}+{second}")


def _whole(screen: Screen, scaled: Array, active: int) -> Location | None:
    """The world or the body whose force explains the residual of several joints."""
    m = screen.motion
    model = m.scene.model
    jacobian = {name: m.point(name).jacobian[screen.rows] for name in m.scene.moving}
    gravity = sum(
        (float(model.body(n).mass[0]) * j for n, j in jacobian.items()),
        np.zeros((len(screen.rows), 3, model.nv)),
    )
    one = np.zeros(len(screen.rows), dtype=int)
    if _fit(gravity / screen.floor, scaled, one) > _EXPLAINS:
        return Location("world", "world")
    if active < _MANY:
        return None
    label = np.arange(len(screen.rows)) // _ROWS
    scores = {name: _fit(j / screen.floor, scaled, label) for name, j in jacobian.items()}
    best = max(scores, key=lambda name: scores[name], default="")
    return Location("body", best) if best and scores[best] > _EXPLAINS else None


def _fit(columns: Array, target: Array, label: Array) -> float:
    """Adjusted R² of one force vector per label.

    Args:
        columns: force on each joint per unit, (R, 3, nv).
        target: (R, nv).
        label: group of each row, (R,).
    """
    left, freedom = 0.0, target.size
    for k in range(int(label.max()) + 1):
        rows = label == k
        design = columns[rows].transpose(0, 2, 1).reshape(-1, 3)
        found, _, rank, _ = np.linalg.lstsq(design, target[rows].reshape(-1), rcond=1e-6)
        left += float(((target[rows].reshape(-1) - design @ found) ** 2).sum())
        freedom -= int(rank)
    return 1.0 - (left / max(freedom, 1)) / float(np.mean(target**2))
