"""Laws that act at every physics step of a replay, where MuJoCo has no element for an effect.

A law is a function of one place, in the Python that Numba compiles::

    @Law
    def _drag(dof, q, v, u, t, h, theta, own):
        return -theta[0] * v[dof] * abs(v[dof])

It is compiled when a replay first needs it (:mod:`wt.physics.compiled`) and kept beside its file,
as bytecode is. What it calls of ours is marked with :func:`in_laws`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

Values = np.ndarray
"""Figures of one place or one replay: where compiled a bare pointer, without length or slices."""
Acts = Callable[[int, Values, Values, Values, float, float, Values, Values], float]
"""Generalised force on a degree of freedom at a physics step [N·m or N]. Its arguments:

the degree of freedom; joint positions and joint velocities of all, and behind them those of their
drives' sides (:func:`wt.physics.driving.motor_side`); commands in force, of all; time since
the start of the recording and length of the step [s]; the law's parameters at this place; what else
is this place's own, which it may change.
"""

Figures = TypeVar("Figures", float, np.ndarray)
"""Of what is computed alike from one figure, in a law, and from many, along a recording."""
_Called = TypeVar("_Called", bound=Callable[..., object])
callable_in_laws: list[Callable[..., object]] = []
"""Functions of ours that laws may call."""


@dataclass(frozen=True)
class Law:
    """A law that acts at every step, which is compiled when it is needed.

    Attributes:
        acts: at one place.
    """

    acts: Acts


def in_laws(function: _Called) -> _Called:
    """Mark a function, of figures or of arrays alike, as one that laws may call."""
    callable_in_laws.append(function)
    return function


@dataclass(frozen=True, eq=False)
class Live:
    """A law at n places.

    Attributes:
        law: what it does at each.
        dofs: degree of freedom that it acts on, or the drives' side of its joint.
        theta: parameters.
        own: what else is each place's own: constants, and what it remembers between steps.
    """

    law: Law
    dofs: Int[np.ndarray, " place"]
    theta: Float[np.ndarray, "place parameter"]
    own: Float[np.ndarray, "place figure"]
