"""Hidden states that a joint's motion drives: what a force that remembers may depend on.

A regression on what was recorded at one moment cannot see a strap that creeps or a liquid that
swings along. Their forces are linear in a hidden state of their own, which follows from the
recorded motion once its rate is known:

``creep[τ s](qvel/j)``
    z with ż = q̇ − z/τ: the stretch of a spring that yields (J. C. Maxwell, 1867).
``swing[ω rad/s, ζ](qpos/j)``
    p − q with p̈ = −ω²(p − q) − 2ζω(ṗ − q̇): how far a mass on a spring lags behind the joint that
    drags it along. ``swing_rate[…](qpos/j)`` is its derivative.

Columns of these names are computed along recorded motions (:func:`along`), and step by step in
replays (:mod:`wt.diagnose.unknown.live`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, cast

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm
from scipy.signal import lfilter

from wt.diagnose.unknown.law import table
from wt.physics.motion import Motion

Kind = Literal["creep", "swing", "swing_rate"]

_NAME = re.compile(r"(creep|swing|swing_rate)\[(\S+) [^,]+?(?:, (\S+))?\]\(q(?:pos|vel)/(.+)\)")


@dataclass(frozen=True)
class Memory:
    """One column that remembers.

    Attributes:
        kind: see the module.
        joint: whose motion drives it.
        rate: time constant of a creep [s]; natural frequency of a swing [rad/s].
        damping: damping ratio of a swing [-].
    """

    kind: Kind
    joint: str
    rate: float
    damping: float = 0.0

    @property
    def name(self) -> str:
        """As in the module; three digits, which are all there are."""
        if self.kind == "creep":
            return f"creep[{self.rate:.3g} s](qvel/{self.joint})"
        return f"{self.kind}[{self.rate:.3g} rad/s, {self.damping:.3g}](qpos/{self.joint})"

    @property
    def base(self) -> tuple[str, ...]:
        """The recorded columns that it is made of."""
        velocity = f"qvel/{self.joint}"
        return (velocity,) if self.kind == "creep" else (f"qpos/{self.joint}", velocity)

    def begin(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """State at rest beside the joint, (n, 2); q and v are (n,)."""
        start = np.stack([q, v], axis=1)
        return np.zeros_like(start) if self.kind == "creep" else start

    def value(self, state: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The column, (n,)."""
        if self.kind == "creep":
            return np.asarray(state[:, 0])
        return np.asarray(state[:, 0] - q if self.kind == "swing" else state[:, 1] - v)

    def transition(self, h: float) -> Float[np.ndarray, "2 4"]:
        """State h seconds later, from it and the joint's position and velocity, which is held."""
        return _transition(self.kind == "creep", self.rate, self.damping, h)


def memory_of(name: str) -> Memory | None:
    """The memory with that name; None for what is recorded itself."""
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    kind, rate, damping, joint = match.groups()
    return Memory(cast(Kind, kind), joint, float(rate), float(damping or 0.0))


def recorded(names: Sequence[str]) -> tuple[str, ...]:
    """The recorded columns behind some columns, each once."""
    columns: list[str] = []
    for name in names:
        memory = memory_of(name)
        columns += memory.base if memory else (name,)
    return tuple(dict.fromkeys(columns))


def along(motion: Motion, names: Sequence[str]) -> Float[np.ndarray, "sample column"]:
    """Values of columns along a recorded motion; segments begin at rest."""
    m = motion
    columns = []
    for name in names:
        memory = memory_of(name)
        if memory is None:
            columns.append(table(m.scene, [name], m.t, m.q, m.v, m.u)[:, 0])
            continue
        dof = m.scene.dof(memory.joint)
        values = np.empty(len(m))
        for s in m.segments:
            values[s.rows] = _path(memory, m.q[s.rows, dof], m.v[s.rows, dof], s.dt)
        columns.append(values)
    return np.stack(columns, axis=1)


def _path(
    memory: Memory, q: Float[np.ndarray, " sample"], v: Float[np.ndarray, " sample"], dt: float
) -> Float[np.ndarray, " sample"]:
    """A column along an evenly sampled path, from rest."""
    moved = memory.transition(dt)
    # held is the mean velocity of an interval, so that sampling coarsely delays nothing
    mean = np.append(np.diff(q) / dt, v[-1])
    begun = memory.begin(q[:1], v[:1])[0]
    poles, modes = np.linalg.eig(moved[:, :2])
    pushed = np.linalg.solve(modes, moved[:, 2:] @ np.stack([q, mean]))
    pushed = np.column_stack([np.linalg.solve(modes, begun), pushed[:, :-1]])
    path = np.stack([lfilter([1.0], [1.0, -p], x) for p, x in zip(poles, pushed, strict=True)])
    return memory.value(np.real(modes @ path).T, q, v)


@lru_cache(maxsize=512)
def _transition(creeps: bool, rate: float, damping: float, h: float) -> Float[np.ndarray, "2 4"]:
    """Two states h seconds later, from them, the joint's position and its held velocity."""
    system = np.zeros((4, 4))
    if creeps:
        system[0] = [-1.0 / rate, 0.0, 0.0, 1.0]
    else:
        pull, drag = rate**2, 2.0 * damping * rate
        system[0] = [0.0, 1.0, 0.0, 0.0]
        system[1] = [-pull, -drag, pull, drag]
    system[2, 3] = 1.0  # the position moves with the velocity
    transition: np.ndarray = expm(system * h)[:2]
    return transition
