"""The experiment for a machine without drives: in words, how to release it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from wt.diagnose.evidence import Trace
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

_SHARES = (0.3, 0.6, 0.9)
"""Heights to release from, as shares of the farthest that was recorded or the model allows."""
_MOVED = 1e-3
"""Joints that moved by less [rad or m] are let be."""


def passive(scene: Scene) -> bool:
    """Whether nothing drives the machine: it can be released, and not commanded."""
    return scene.model.nactuator == 0


def release(scene: Scene, traces: Sequence[Trace]) -> str:
    """How to release a machine so that its recordings tell more than those so far.

    Args:
        scene: the machine, without drives.
        traces: what was recorded; the poses named stay inside it.
    """
    m, said = scene.model, []
    low, high = _seen(len(scene.joints), traces)
    for joint in scene.own_joints:
        dof = scene.dof(joint)
        if not high[dof] - low[dof] > _MOVED:
            continue
        rest = float(m.qpos0[dof])
        # to the side on which more was seen
        end = max((low[dof], high[dof]), key=lambda x: abs(x - rest))
        units = units_at(scene, Location("joint", joint))
        poses = [units.distance(float(rest + share * (end - rest)), 2) for share in _SHARES]
        said.append(f"{joint} from {', '.join(poses[:-1])} and {poses[-1]}")
    where = "; ".join(said) or "it from several poses near those recorded"
    return (
        f"hold the machine still, release it without a push and record until it rests: {where}; "
        "each release twice, and once with a known weight on it"
    )


def _seen(
    count: int, traces: Sequence[Trace]
) -> tuple[Float[np.ndarray, " dof"], Float[np.ndarray, " dof"]]:
    """Smallest and largest recorded positions; NaN where nothing was measured."""
    rows = [t.recorded for t in traces]
    together = np.concatenate(rows) if rows else np.full((1, count), np.nan)
    known = np.isfinite(together)
    low = np.where(known, together, np.inf).min(axis=0)
    high = np.where(known, together, -np.inf).max(axis=0)
    return np.where(known.any(axis=0), low, np.nan), np.where(known.any(axis=0), high, np.nan)
