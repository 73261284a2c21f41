"""A force as a sum of products of simple functions of recorded columns: readable and portable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from wt.physics.scene import Scene

AtomKind = Literal["linear", "sign", "square", "size", "side", "sin", "cos", "bump", "kink"]

MARGINS = {"qpos": 0.25}
"""Beyond the range of a column the force fades to zero over this share of it; else over all."""


@dataclass(frozen=True)
class Atom:
    """A function of one column x.

    Attributes:
        column: index of the column.
        kind: ``linear`` x; ``sign`` tanh(x / b), a sign rounded for integration; ``square`` |x|·x;
            ``size`` |x|; ``side`` max(b·x, 0), with b of 1 or −1;
            ``sin``, ``cos`` of b·x; ``bump`` exp(−s²) and ``kink`` s·exp(−s²), s = (x − a) / b.
        a: centre of a bump or kink.
        b: width, rounding, angular frequency or sign.
    """

    column: int
    kind: AtomKind
    a: float = 0.0
    b: float = 1.0

    def value(self, x: np.ndarray) -> np.ndarray:
        """The function of its column's values, elementwise."""
        result: np.ndarray
        if self.kind == "linear":
            result = x
        elif self.kind == "sign":
            result = np.tanh(x / self.b)
        elif self.kind == "square":
            result = np.abs(x) * x
        elif self.kind == "size":
            result = np.abs(x)
        elif self.kind == "side":
            result = np.maximum(self.b * x, 0.0)
        elif self.kind == "sin":
            result = np.sin(self.b * x)
        elif self.kind == "cos":
            result = np.cos(self.b * x)
        else:
            s = (x - self.a) / self.b
            result = np.exp(-(s**2)) * (s if self.kind == "kink" else 1.0)
        return result

    def text(self, name: str) -> str:
        """In the column's name."""
        turns = "" if self.b == 1.0 else f"{self.b:.3g}·"
        s = f"(({name} {_signed(-self.a)})/{self.b:.3g})"
        return {
            "linear": name,
            "sign": f"sign({name})",
            "square": f"|{name}|·{name}",
            "size": f"|{name}|",
            "side": f"max({'-' if self.b < 0.0 else ''}{name}, 0)",
            "sin": f"sin({turns}{name})",
            "cos": f"cos({turns}{name})",
            "bump": f"exp(-{s}^2)",
            "kink": f"{s}·exp(-{s}^2)",
        }[self.kind]


Term = tuple[Atom, ...]
"""A product of at most two atoms; () is the constant 1."""


@dataclass(frozen=True, eq=False)
class Law:
    """force = Σ weight · term, of columns clipped to a range; far outside of it, zero.

    Attributes:
        columns: names, as in recordings.
        low: smallest value at which each is trusted.
        high: largest.
        terms: products of atoms.
        weights: one a term [N·m].
    """

    columns: tuple[str, ...]
    low: Float[np.ndarray, " column"]
    high: Float[np.ndarray, " column"]
    terms: tuple[Term, ...]
    weights: Float[np.ndarray, " term"]

    @cached_property
    def atoms(self) -> tuple[Atom, ...]:
        """Every different atom, sorted by kind."""
        return tuple(sorted({a for t in self.terms for a in t}, key=lambda a: (a.kind, a.column)))

    @cached_property
    def factors(self) -> Int[np.ndarray, "term 2"]:
        """For each term the indices of its two factors among the atoms; after these, the one."""
        index = {a: i for i, a in enumerate(self.atoms)}
        one = len(self.atoms)
        rows = [[*(index[a] for a in t), one, one][:2] for t in self.terms]
        return np.array(rows, dtype=np.int64).reshape(-1, 2)

    @cached_property
    def margin(self) -> Float[np.ndarray, " column"]:
        """Distance beyond the range at which the force ends."""
        share = np.array([MARGINS.get(name.partition("/")[0], 1.0) for name in self.columns])
        return np.maximum(share * (self.high - self.low), 1e-6)

    def force(self, x: np.ndarray) -> np.ndarray:
        """Force of column values (N, n), (N,) [N·m]."""
        if not self.terms:
            return np.zeros(len(x))
        inside = np.clip(x, self.low, self.high)
        fade = np.clip(1.0 - np.abs(x - inside) / self.margin, 0.0, 1.0).prod(axis=1)
        values = [a.value(inside[:, a.column]) for a in self.atoms]
        table = np.stack([*values, np.ones(len(x))], axis=1)
        products = table[:, self.factors[:, 0]] * table[:, self.factors[:, 1]]
        return np.asarray(fade * (products @ self.weights))

    def text(self) -> str:
        """The formula, e.g. ``"-1.2·sign(qvel/j2) + 0.4·qpos/j1"``."""
        parts = []
        for term, weight in zip(self.terms, self.weights, strict=True):
            factors = "·".join(a.text(self.columns[a.column]) for a in term)
            parts.append(_signed(float(weight)) + ("·" + factors if factors else ""))
        if not parts:
            return "0"
        first = parts[0]
        parts[0] = first[2:] if first.startswith("+") else "-" + first[2:]
        return " ".join(parts)


def _signed(value: float) -> str:
    return f"{'-' if value < 0.0 else '+'} {abs(value):.3g}"


def table(
    scene: Scene,
    names: Sequence[str],
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    u: np.ndarray,
) -> np.ndarray:
    """Values of columns at some states, (N, len(names)).

    Args:
        scene: the machine.
        names: ``t``, ``qpos/<joint>``, ``qvel/<joint>``, ``ctrl/<actuator>`` or
            ``force/<actuator>``; the last is the force of the model's drive on its joint.
        t: times, (N,).
        q: joint positions, (N, nv).
        v: joint velocities, (N, nv).
        u: commands, (N, nu).
    """
    columns = []
    for name in names:
        kind, _, place = name.partition("/")
        if kind == "qpos":
            columns.append(q[:, scene.dof(place)])
        elif kind == "qvel":
            columns.append(v[:, scene.dof(place)])
        elif kind == "ctrl":
            columns.append(u[:, scene.model.actuator(place).id])
        elif kind == "force":
            drive = scene.drive(place)
            command, dof = u[:, drive.index], drive.dof
            columns.append(drive.force(command, q[:, dof], v[:, dof]))
        else:
            columns.append(t)
    return np.stack(columns, axis=1)
