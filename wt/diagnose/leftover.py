"""What accepted effects and the errors of any rig leave of the weak force residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt.diagnose.assessed import Hypothesis
from wt.diagnose.scoring import bounded, boxed
from wt.diagnose.screen import Screen
from wt.diagnose.signature import signature

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Leftover:
    """The weak force residual, taken apart.

    Attributes:
        left: what nothing explains, (R, nv) [N·m].
        adapted: what the errors of any rig explain, (R, nv).
        parts: force of each effect of the hypothesis, (R, nv) each; zero where an effect has no
            signature in forces.
        keep: rows that count for each degree of freedom: moving, unless that drops most, (R, nv).
    """

    left: Array
    adapted: Array
    parts: tuple[Array, ...]
    keep: Array

    def without(self, index: int) -> Array:
        """What is left if one of the effects is taken back, (R, nv) [N·m]."""
        return np.asarray(self.left + self.parts[index])


def leftover(screen: Screen, hypothesis: Hypothesis) -> Leftover:
    """Fit the signatures of a hypothesis and the bounded nuisances to the weak residual."""
    signatures = [signature(screen.motion, p) for p in hypothesis]
    free = [screen.weak_force(s) for s in signatures if s is not None]
    columns = np.concatenate([*free, screen.nuisance], axis=2)
    bound, keep = boxed(columns, screen), screen.keep
    x = np.zeros(columns.shape[2])
    mse = np.mean(screen.residual**2, axis=0)
    for _ in range(3):
        x = bounded(columns, screen.residual, keep / np.maximum(mse, screen.floor**2), bound)
        left = screen.residual - columns @ x
        mse = (keep * left**2).sum(axis=0) / np.maximum(keep.sum(axis=0), 1)
    parts, start = [], 0
    for s in signatures:
        size = 0 if s is None else s.shape[2]
        parts.append(columns[:, :, start : start + size] @ x[start : start + size])
        start += size
    adapted = columns[:, :, start:] @ x[start:]
    return Leftover(screen.residual - columns @ x, adapted, tuple(parts), keep)
