"""What quantities without a telling name are, by how they move.

A velocity is the slope of its position; a command is what a position follows a little later.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from wt.data.importers._survey import Quantity

_ALIKE = 0.97  # correlation of a velocity with a slope
_FOLLOWS = 0.9  # of a position with the command before it
_LONGEST = 40  # samples that a position may lag behind its command
_MOST = 64  # quantities that are compared with each other

_Values = Float64[np.ndarray, " sample"]


def kinds(t: _Values, silent: Sequence[Quantity]) -> list[tuple[str, str, Quantity]]:
    """(kind, joint, quantity) of those that can be told; joints are counted.

    Args:
        t: times [s].
        silent: quantities whose names say nothing.
    """
    moving = [q for q in silent if len(q.values) == len(t) and _moves(q.values)][:_MOST]
    pairs = _slopes(t, moving)
    taken = {q.name for pair in pairs for q in pair}
    rest = [q for q in moving if q.name not in taken]
    found = []
    positions = [position for position, _ in pairs] or rest
    for k, position in enumerate(positions):
        found.append(("qpos", f"joint{k}", position))
        found += [("qvel", f"joint{k}", v) for p, v in pairs if p is position]
    if pairs:
        for k, position in enumerate(positions):
            command = _command(position.values, [q for q in rest if q.name not in taken])
            if command is not None:
                taken.add(command.name)
                found.append(("ctrl", f"joint{k}", command))
    return found


def _moves(values: _Values) -> bool:
    return bool(np.isfinite(values).all() and np.std(values) > 1e-9)


def _slopes(t: _Values, moving: Sequence[Quantity]) -> list[tuple[Quantity, Quantity]]:
    """(position, velocity) pairs, the surest first, none twice."""
    alike = []
    for position in moving:
        slope = np.gradient(position.values, t)
        for velocity in moving:
            if velocity is not position:
                r = _correlation(slope, velocity.values)
                factor = np.std(velocity.values) / (np.std(slope) + 1e-30)
                if r > _ALIKE and 0.01 < factor < 100.0:
                    alike.append((r, position, velocity))
    pairs: list[tuple[Quantity, Quantity]] = []
    used: set[str] = set()
    for _, position, velocity in sorted(alike, key=lambda each: -each[0]):
        if not {position.name, velocity.name} & used:
            used |= {position.name, velocity.name}
            pairs.append((position, velocity))
    return sorted(pairs, key=lambda pair: [q.name for q in moving].index(pair[0].name))


def _command(position: _Values, rest: Sequence[Quantity]) -> Quantity | None:
    """What the position follows."""
    best, which = _FOLLOWS, None
    for quantity in rest:
        for lag in range(1, min(_LONGEST, len(position) // 4)):
            r = _correlation(quantity.values[:-lag], position[lag:])
            if r > best:
                best, which = r, quantity
    return which


def _correlation(a: _Values, b: _Values) -> float:
    if np.std(a) < 1e-12 or np.std(b) < 1e-12:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
