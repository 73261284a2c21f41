"""Where simulation and recording part, when, and under which condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wt.diagnose.assessed import Hypothesis
from wt.diagnose.condition import condition, intervals
from wt.diagnose.leftover import Leftover, leftover
from wt.diagnose.result import Located
from wt.diagnose.screen import Screen
from wt.diagnose.structure import places
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

Array = np.ndarray


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
    largest: dict[Location, tuple[float, Array]] = {}

    def add(at: Location, share: float, size: Array) -> None:
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
    screen: Screen, at: Location, share: float, size: Array, names: Sequence[str]
) -> Located:
    """A place with the times and the condition at which a residual (R,) shows."""
    scene = screen.motion.scene
    dof = _dofs(scene, at)[-1]
    own = at.kind in ("joint", "actuator")
    of = "" if own else f" of joint {scene.joints[dof]}"
    when = intervals(screen, size, names)
    return Located(at, share, when, condition(screen, size, dof, of))


def _size(screen: Screen, rest: Leftover, index: int, planted: Planted) -> Array:
    """Residual that an effect accounts for, in units of its noise floor, (R,).

    Where its signature explains most of what is there, the signature, which has no noise; else
    what is left if the effect is taken back.
    """
    dofs = _dofs(screen.motion.scene, planted.at)
    part, whole = (x / screen.floor for x in (rest.parts[index], rest.without(index)))
    explained = float(((whole - part)[:, dofs] ** 2).sum()) < 0.5 * float(
        (whole[:, dofs] ** 2).sum()
    )
    return _norm(part if explained else whole, dofs)


def _norm(scaled: Array, dofs: Sequence[int]) -> Array:
    """Root mean square over degrees of freedom, (R,)."""
    return np.sqrt(np.mean(scaled[:, list(dofs)] ** 2, axis=1))


def _dofs(scene: Scene, at: Location) -> list[int]:
    """Degrees of freedom on which a place acts; its own joint last."""
    every = list(range(scene.model.nv))
    names = [name for name in at.name.split("+") if name in scene.joints]
    if at.kind in ("joint", "sensor", "pair") and names:
        return [scene.dof(name) for name in names]
    if at.kind == "actuator" and at.name in {d.name for d in scene.drives}:
        return [scene.drive(at.name).dof]
    if at.kind in ("body", "geom"):
        element = scene.model.body(at.name) if at.kind == "body" else scene.model.geom(at.name)
        body = int(element.id if at.kind == "body" else element.bodyid[0])
        carried = np.flatnonzero(scene.carries(body))
        return [int(d) for d in carried] or every
    return every
