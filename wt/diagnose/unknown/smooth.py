"""A force that is a smooth function of a joint's position, with as many figures as are granted it.

What a law of the position has to beat: a name that says no more than a curve does, says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from jaxtyping import Float

from wt.diagnose.unknown.force import UnknownForce
from wt.diagnose.unknown.law import Atom, Law, Term
from wt.diagnose.unknown.live import live
from wt.physics.effect import Parameter, Shape
from wt.physics.live import Live
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.types import Location

_BENDS = 0.5 * np.pi
"""[rad] Of a sine and a cosine over a joint's way: what they add to a parabola bends as a cubic and
a quartic do, and does not come again."""


class SmoothForce(UnknownForce):
    """Σ c_k · curve_k(position): curves that are independent along a motion.

    Not registered: it is nobody's claim.

    Attributes:
        mixed: weights of the law's terms for each curve.
    """

    def __init__(self, law: Law, mixed: Float[np.ndarray, "term curve"]) -> None:
        """Wrap terms, and how the curves are made of them."""
        super().__init__(law, "")
        self.mixed = mixed
        named = [Parameter(f"curve_{k}", "N·m", -1e8, 1e8, 1e-3) for k in range(mixed.shape[1])]
        self.parameters = tuple(named)  # type: ignore[assignment, misc]  # as granted

    def summed(self, theta: Float[np.ndarray, " parameter"]) -> Law:
        """All curves as one law."""
        return replace(self.law, weights=self.mixed @ theta)

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Each curve along a motion."""
        dof = motion.scene.dof(at.name)
        x = motion.q[:, [dof]]
        return motion.on(dof, *(replace(self.law, weights=w).force(x) for w in self.mixed.T))

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Adds the force at every step."""
        one = np.ones((1, 1))
        laws = [self.summed(c) for c in theta]
        each = [live(x, scene, [place], one, h) for x, place in zip(laws, at, strict=True)]
        own = np.concatenate([a.own for a in each])
        dofs = np.concatenate([a.dofs for a in each])
        return Live(each[0].law, dofs, np.ones((len(at), 1)), own)


def smooth_force(motion: Motion, joint: str, count: int) -> SmoothForce:
    """So many curves of a joint's position, orthogonal along a motion: a constant first."""
    dof = motion.scene.dof(joint)
    q = motion.q[:, dof]
    low, high = np.array([q.min()]), np.array([q.max()])
    x = Atom(0, "linear")
    terms: list[Term] = [(), (x,), (x, x)]
    for k in range(1, count):
        turns = k * _BENDS / max(float(high[0] - low[0]), 1e-9)
        terms += [(Atom(0, "sin", 0.0, turns),), (Atom(0, "cos", 0.0, turns),)]
    law = Law((f"qpos/{joint}",), low, high, tuple(terms[:count]), np.zeros(count))
    table = np.stack([replace(law, weights=w).force(q[:, None]) for w in np.eye(count)], axis=1)
    _, r = np.linalg.qr(table / np.sqrt(len(q)))
    return SmoothForce(law, cast(np.ndarray, np.linalg.inv(r)))
