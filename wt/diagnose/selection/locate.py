"""Places where simulation and recording part, and which element of the machine they point to.

A fault of a joint or its drive shows on that joint only; a coupling of two joints on both, in a
fixed ratio; a force on a body on all joints that carry it, in the proportions of Jᵀf; a wrong
direction of gravity on all joints, with one constant vector; a sensor's fault in replays but in no
force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from wt.diagnose.residual.screen import Leftover, Screen, leftover
from wt.diagnose.result import Located
from wt.diagnose.selection.condition import condition, intervals
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis, Planted
from wt.physics.scene import Scene
from wt.types import Location


def locate(
    screen: Screen,
    hypothesis: Hypothesis,
    shares: Sequence[float],
    *,
    unexplained: Mapping[str, float] | None = None,
    names: Sequence[str] = (),
) -> tuple[Located, ...]:
    """Places where physics is missing, ranked by their share of the mismatch.

    Args:
        screen: the weak force residual of the fitted recordings.
        hypothesis: the findings.
        shares: weight of each finding; they are scaled to what is explained.
        unexplained: joint → share (0…1) of the mismatch that no finding explains; where in the
            machine it arises is judged by how the force residual spreads over the joints.
        names: of the recordings, by index.

    Returns:
        One entry per place; nothing if there are neither findings nor anything unexplained.
    """
    rest = leftover(screen, hypothesis)
    open_ = {joint: share for joint, share in (unexplained or {}).items() if share > 0.0}
    lost = min(sum(open_.values()), 1.0) if hypothesis else 1.0
    weights = np.maximum(np.asarray(shares, dtype=float), 0.0)
    weights = (1.0 - lost if open_ else 1.0) * weights / max(float(weights.sum()), 1e-12)
    seen: dict[Location, float] = {}
    largest: dict[Location, tuple[float, Float[np.ndarray, " row"]]] = {}

    def add(at: Location, share: float, size: Float[np.ndarray, " row"]) -> None:
        """Enter a place; of several effects at one place, the largest says when."""
        seen[at] = min(seen.get(at, 0.0) + share, 1.0)
        if at not in largest or share >= largest[at][0]:
            largest[at] = (share, size)

    for i, planted in enumerate(hypothesis):
        add(planted.at, float(weights[i]), _size(screen, rest, i, planted))
    if open_:
        for at, share in places(screen, rest, open_).items():
            dofs = _dofs(screen.motion.scene, at)
            # the errors of any rig bear a part of it, and spread it: only what stands out twice
            options = (rest.left, rest.left + rest.adapted)
            size = np.minimum(*(_norm(x / screen.floor, dofs) for x in options))
            add(at, lost * share, size)
    places_ = [_located(screen, at, seen[at], size, names) for at, (_, size) in largest.items()]
    return tuple(sorted(places_, key=lambda p: -p.share))


def _located(
    screen: Screen,
    at: Location,
    share: float,
    size: Float[np.ndarray, " row"],
    names: Sequence[str],
) -> Located:
    """A place with the times and the condition at which a residual (R,) shows."""
    scene = screen.motion.scene
    dof = _dofs(scene, at)[-1]
    own = at.kind in ("joint", "actuator") and at.name != "all"
    of = "" if own else f" of joint {scene.joints[dof]}"
    when = intervals(screen, size, names)
    return Located(at, share, when, condition(screen, size, dof, of))


def _size(
    screen: Screen, rest: Leftover, index: int, planted: Planted
) -> Float[np.ndarray, " row"]:
    """Residual that an effect accounts for, in units of its noise floor, (R,).

    Where its signature explains most of what is there, the signature, which has no noise; else
    what is left if the effect is taken back.
    """
    dofs = _dofs(screen.motion.scene, planted.at)
    part, total = (x / screen.floor for x in (rest.parts[index], rest.without(index)))
    explained = float(((total - part)[:, dofs] ** 2).sum()) < 0.5 * float(
        (total[:, dofs] ** 2).sum()
    )
    return _norm(part if explained else total, dofs)


def _norm(scaled: Float[np.ndarray, "row dof"], dofs: Sequence[int]) -> Float[np.ndarray, " row"]:
    """Root mean square over degrees of freedom, (R,)."""
    return np.sqrt(np.mean(scaled[:, list(dofs)] ** 2, axis=1))


def _dofs(scene: Scene, at: Location) -> list[int]:
    """Degrees of freedom on which a place acts; its own joint last."""
    every = list(range(scene.model.nv))
    names = [name for name in at.name.split("+") if name in scene.joints]
    if at.kind in ("joint", "sensor", "pair") and names:
        return [scene.dof(name) for name in names]
    if at.kind == "actuator" and at.name in {"all", *(d.name for d in scene.drives)}:
        return [drive.dof for drive in scene.driven(at)]
    if at.kind in ("body", "geom") and at.name != "all":
        element = scene.model.body(at.name) if at.kind == "body" else scene.model.geom(at.name)
        body = int(element.id if at.kind == "body" else element.bodyid[0])
        carried = np.flatnonzero(scene.carries(body))
        return [int(d) for d in carried] or every
    return every


_MANY = 4  # joints from which three components of a force do not explain just anything
_ROWS = 8  # neighbouring rows that share one force on a body


def places(screen: Screen, rest: Leftover, joints: Mapping[str, float]) -> dict[Location, float]:
    """Places at which an unexplained residual arises, with shares that sum to 1.

    Args:
        screen: the recordings.
        rest: what the findings leave.
        joints: joint → weight of its unexplained replay error.
    """
    scene = screen.motion.scene
    scaled = rest.left / screen.floor
    rms = np.sqrt(np.mean(scaled**2, axis=0))
    named = [scene.dof(j) for j in joints]
    active = [d for d in range(len(rms)) if rms[d] > THRESHOLDS.joint_active]
    if (
        len(active) > 1
        and float(rms.max() ** 2 / (rms[active] ** 2).sum()) < THRESHOLDS.joint_alone
    ):
        # with and without what the errors of any rig may have hidden of it
        for sizes in ((rest.left + rest.adapted) / screen.floor, scaled):
            shared = _pair(screen, sizes) or _whole(screen, sizes, len(active))
            if shared:
                return {shared: 1.0}
    # in no force: a sensor of that joint; otherwise the joint itself
    own = [d for d in named if d in active] or named
    weight: dict[Location, float] = {}
    for joint in (scene.joints[d] for d in own):
        at = scene.place(joint)
        weight[at] = weight.get(at, 0.0) + joints[joint]
    total = sum(weight.values())
    return {at: w / total for at, w in weight.items()}


def _pair(screen: Screen, scaled: Float[np.ndarray, "row dof"]) -> Location | None:
    """Two joints with forces in a fixed ratio, as a cable or a belt over both would have."""
    energy = (scaled**2).sum(axis=0)
    two = sorted(np.argsort(-energy)[:2])
    if energy[two].sum() < THRESHOLDS.joints_together * energy.sum():
        return None
    if abs(float(np.corrcoef(scaled[:, two].T)[0, 1])) < THRESHOLDS.joints_together:
        return None
    first, second = (screen.motion.scene.joints[d] for d in two)
    return Location("pair", f"{first}+{second}")


def _whole(screen: Screen, scaled: Float[np.ndarray, "row dof"], active: int) -> Location | None:
    """The world or the body whose force explains the residual of several joints."""
    m = screen.motion
    model = m.scene.model
    jacobian = {name: m.point(name).jacobian[screen.rows] for name in m.scene.moving}
    gravity = sum(
        (float(model.body(n).mass[0]) * j for n, j in jacobian.items()),
        np.zeros((len(screen.rows), 3, model.nv)),
    )
    one = np.zeros(len(screen.rows), dtype=int)
    if _fit(gravity / screen.floor, scaled, one) > THRESHOLDS.body_explains:
        return Location("world", "world")
    if active < _MANY:
        return None
    label = np.arange(len(screen.rows)) // _ROWS
    scores = {name: _fit(j / screen.floor, scaled, label) for name, j in jacobian.items()}
    best = max(scores, key=lambda name: scores[name], default="")
    return Location("body", best) if best and scores[best] > THRESHOLDS.body_explains else None


def _fit(
    columns: Float[np.ndarray, "row axis dof"],
    target: Float[np.ndarray, "row dof"],
    label: Int[np.ndarray, " row"],
) -> float:
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
        coefficients, _, rank, _ = np.linalg.lstsq(design, target[rows].reshape(-1), rcond=1e-6)
        left += float(((target[rows].reshape(-1) - design @ coefficients) ** 2).sum())
        freedom -= int(rank)
    return 1.0 - (left / max(freedom, 1)) / float(np.mean(target**2))
