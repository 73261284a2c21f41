"""A learned law as it acts at every physics step of a replay: its columns, atoms and terms.

What is a place's own are three figures, how many it has of each, and then each of them as a row:

column  kind, index of its joint or command, low, high, margin, its value now; then the figures of
        its drive, or how its hidden state moves on (2, 4) and that state (2,), NaN at the beginning
atom    column, kind, a, b, its value now; the last one is 1
term    its two atoms and its weight
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import get_args

import numpy as np
from jaxtyping import Float

from wt.diagnose.unknown.law import Atom, AtomKind, Law
from wt.diagnose.unknown.memory import memory_of
from wt.physics.driving import figures, force_of
from wt.physics.live import Law as LawInSteps
from wt.physics.live import Live, Values, in_laws
from wt.physics.scene import Scene
from wt.types import Location

_HEAD, _COLUMN, _ATOM, _TERM = 3, 17, 5, 3  # figures of each row
_TIME, _POSITION, _VELOCITY, _COMMAND, _FORCE, _CREEP, _SWING, _SWING_RATE = range(8)
_RECORDED = {"t": _TIME, "qpos": _POSITION, "qvel": _VELOCITY, "ctrl": _COMMAND, "force": _FORCE}
_REMEMBERED = {"creep": _CREEP, "swing": _SWING, "swing_rate": _SWING_RATE}
_LINEAR, _SIGN, _SQUARE, _SIZE, _SIDE, _SIN, _COS, _BUMP, _KINK = range(len(get_args(AtomKind)))
_ONE = -1


def live(
    law: Law,
    scene: Scene,
    at: Sequence[Location],
    theta: Float[np.ndarray, "place parameter"],
    h: float,
) -> Live:
    """A learned law at some places, times the amplitude at each.

    Args:
        law: the force.
        scene: the machine.
        at: joints.
        theta: amplitudes, (n, 1).
        h: physics step [s].
    """
    dofs = np.array([scene.dof(place.name) for place in at])
    atoms = [*law.atoms, None]
    rows = [
        np.array([len(law.columns), len(atoms), len(law.terms)], dtype=float),
        *(_column(law, i, scene, h) for i in range(len(law.columns))),
        *(_atom(atom) for atom in atoms),
        *(np.array([*pair, w]) for pair, w in zip(law.factors, law.weights, strict=True)),
    ]
    return Live(_learned, dofs, theta, np.tile(np.concatenate(rows), (len(at), 1)))


def _column(law: Law, i: int, scene: Scene, h: float) -> Float[np.ndarray, " figure"]:
    row = np.zeros(_COLUMN)
    row[2:5] = law.low[i], law.high[i], law.margin[i]
    kind, _, place = law.columns[i].partition("/")
    memory = memory_of(law.columns[i])
    if memory is not None:
        row[:2] = _REMEMBERED[memory.kind], scene.dof(memory.joint)
        row[6:14], row[14:] = memory.transition(h).ravel(), np.nan
    elif kind == "force":
        drive = scene.drive(place)
        row[:2], row[6:] = (_FORCE, drive.dof), figures(scene, drive)
    elif kind == "ctrl":
        row[:2] = _COMMAND, scene.model.actuator(place).id
    else:
        row[:2] = _RECORDED[kind], scene.dof(place) if place else 0
    return row


def _atom(atom: Atom | None) -> Float[np.ndarray, " figure"]:
    if atom is None:
        return np.array([0.0, _ONE, 0.0, 1.0, 1.0])
    return np.array([atom.column, get_args(AtomKind).index(atom.kind), atom.a, atom.b, 0.0])


@LawInSteps
def _learned(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    atoms = _HEAD + int(own[0]) * _COLUMN
    terms = atoms + int(own[1]) * _ATOM
    fade = theta[0]
    for at in range(_HEAD, atoms, _COLUMN):
        x = _value_of(own, at, q, v, u, t)
        own[at + 5] = min(max(x, own[at + 2]), own[at + 3])
        fade *= max(0.0, 1.0 - abs(x - own[at + 5]) / own[at + 4])
    for at in range(atoms, terms, _ATOM):
        x = own[_HEAD + int(own[at]) * _COLUMN + 5]
        own[at + 4] = _shape(int(own[at + 1]), x, own[at + 2], own[at + 3])
    total = 0.0
    for at in range(terms, terms + int(own[2]) * _TERM, _TERM):
        first, second = atoms + int(own[at]) * _ATOM, atoms + int(own[at + 1]) * _ATOM
        total += own[at + 2] * own[first + 4] * own[second + 4]
    return fade * total


@in_laws
def _value_of(own: Values, at: int, q: Values, v: Values, u: Values, t: float) -> float:
    """A column, as of :func:`wt.diagnose.unknown.law.table`; what it remembers moves on."""
    kind, index = int(own[at]), int(own[at + 1])
    if kind >= _CREEP:
        return _remembered(own, at + 6, kind, q[index], v[index])
    if kind == _FORCE:
        return force_of(own, at + 6, q, v, u)
    if kind == _COMMAND:
        return u[index]
    if kind == _TIME:
        return t
    return q[index] if kind == _POSITION else v[index]


@in_laws
def _remembered(own: Values, at: int, kind: int, q: float, v: float) -> float:
    """A column with a hidden state of its own, as of :class:`wt.diagnose.unknown.memory.Memory`."""
    if math.isnan(own[at + 8]):  # at rest beside the joint
        own[at + 8], own[at + 9] = (0.0, 0.0) if kind == _CREEP else (q, v)
    z, rate = own[at + 8], own[at + 9]
    for i in range(2):
        row = at + 4 * i
        own[at + 8 + i] = own[row] * z + own[row + 1] * rate + own[row + 2] * q + own[row + 3] * v
    if kind == _CREEP:
        return z
    return z - q if kind == _SWING else rate - v


@in_laws
def _shape(kind: int, x: float, a: float, b: float) -> float:
    """An atom's function of its column's value, as of :meth:`Atom.value`."""
    if kind == _ONE:
        return 1.0
    if kind == _LINEAR:
        return x
    if kind == _SIGN:
        return math.tanh(x / b)
    if kind == _SQUARE:
        return abs(x) * x
    if kind == _SIZE:
        return abs(x)
    if kind == _SIDE:
        return max(b * x, 0.0)
    if kind == _SIN:
        return math.sin(b * x)
    if kind == _COS:
        return math.cos(b * x)
    s = (x - a) / b
    return math.exp(-(s**2)) * (s if kind == _KINK else 1.0)
