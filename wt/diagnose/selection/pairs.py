"""Pairs: two effects at a joint that join together, since neither alone explains it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wt.diagnose.likelihood.bic import erring_joints, excess
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.residual.screen import Scored, Screen
from wt.diagnose.selection.candidates import dof_of, excluded
from wt.physics.effect import Shape
from wt.physics.planted import Planted

_PAIRED, _PAIRS = 8, 3
"""So many at a joint are paired, and so many of the pairs replayed, beside friction, …"""
_PAIRED_JOINTS = 4
"""… at so many joints, those that err most: where all of a robot's do, the cause is one of all."""


def paired(
    screen: Screen,
    objective: Objective,
    now: Assessed,
    known: Sequence[tuple[Planted, Shape | None]],
    ranked: Sequence[Scored],
    fits: Sequence[Assessed],
) -> list[tuple[Planted, Planted]]:
    """Two additions at a joint that no single one explains.

    Real joints lack several things at once, each of which alone explains little: dry and viscous
    friction, say. What wins alone may then be none of them. The force residual knows which two.
    """
    groups: list[list[Scored]] = []
    for dof in np.argsort(-excess(objective, now), kind="stable").tolist():
        tried = [f for f in fits if dof_of(screen, f.hypothesis[-1].at) == dof]
        if not tried or any(dof not in erring_joints(objective, f) for f in tried):
            continue
        if len(groups) == _PAIRED_JOINTS:
            break
        here = [s for s in ranked if dof_of(screen, s.planted.at) == dof]
        usual = [s for s in here[_PAIRED:] if _usual(s.planted)]
        groups.append([*here[:_PAIRED], *usual])
    starts = []
    for pairs in screen.pairs(known, groups):
        allowed = [(p.first, p.second) for p in pairs if not excluded(p.first, p.second)]
        friction = [p for p in allowed[_PAIRS:] if all(_usual(x) for x in p)]
        starts += [*allowed[:_PAIRS], *friction]
    return starts


def _usual(planted: Planted) -> bool:
    """Tell whether joints often have it beside another: dry and viscous friction, and drag."""
    return planted.effect.kind == "joint" and planted.effect.common != "seldom"
