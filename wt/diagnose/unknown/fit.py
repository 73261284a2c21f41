"""Regressions of an unexplained force on columns, judged by blocks of time they have not seen.

Features are computed along the motion and pass the same weak form as the force, so that windows
that are wide beside a bump do not blur the law.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve

from wt.diagnose.residual.screen import Screen
from wt.diagnose.unknown.law import Atom, Law, Term
from wt.diagnose.unknown.terms import weak_terms

FOLDS, BLOCK_S, MOMENT_S = 6, 1.5, 0.5
_RIDGES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)  # relative to the number of rows
_NEXT_TO_NONE = (1e-9,)
_BUMPS = 14


class ForceData:
    """One joint's unexplained force beside the columns that it may depend on.

    Attributes:
        screen: the recordings.
        joint: the joint.
        dof: its degree of freedom.
        force: weak force [N·m], of the n rows that count.
        rows: the rows of the screen that count, as a mask.
        block: index of the block of time that each of the n rows belongs to.
        fold: of the block, likewise.
        moment: index of a shorter stretch, yet longer than the noise of a force remembers.
        ease: speed over which a sign is rounded [rad/s]: a stiffer law would not be integrable.
    """

    def __init__(
        self,
        screen: Screen,
        joint: str,
        force: Float[np.ndarray, " row"],
        rows: Bool[np.ndarray, " row"],
        seed: int,
        step: float,
    ) -> None:
        """Prepare.

        Args:
            screen: the recordings.
            joint: the joint.
            force: its unexplained weak force [N·m].
            rows: the rows that count.
            seed: assigns blocks to folds.
            step: coarsest physics step of replays [s].
        """
        self.screen, self.joint, self.rows = screen, joint, rows
        self.dof = screen.motion.scene.dof(joint)
        self.force, self._terms = force[rows], weak_terms(screen)
        motion = screen.motion
        segment = np.zeros(len(motion), dtype=int)
        for i, s in enumerate(motion.segments):
            segment[s.rows] = i
        at = screen.rows[rows]
        self.block, self.moment = (
            np.unique(
                np.stack([segment[at], (motion.t[at] / seconds).astype(int)]),
                axis=1,
                return_inverse=True,
            )[1].ravel()
            for seconds in (BLOCK_S, MOMENT_S)
        )
        order = np.random.default_rng(seed).permutation(int(self.block.max()) + 1)
        self.fold = (np.argsort(order) % FOLDS)[self.block]
        inertia = float(motion.scene.model.dof_M0[self.dof])
        strong = float(np.quantile(np.abs(self.force), 0.95))
        self.ease = max(0.02, strong * step / inertia)
        self._bumps = int(np.clip(len(self.force) / 25, 6, _BUMPS))

    def column(self, name: str) -> Float[np.ndarray, " sample"]:
        """Values along the motion."""
        return self._terms.column(name)

    def span(self, name: str) -> tuple[float, float]:
        """Smallest and largest value of a column."""
        x = self.column(name)
        return float(x.min()), float(x.max())

    def state(self) -> list[str]:
        """Positions and velocities that vary, the joint's own first, and time."""
        joints = sorted(self.screen.motion.scene.joints, key=lambda j: j != self.joint)
        return self._varying([*(f"{k}/{j}" for j in joints for k in ("qpos", "qvel")), "t"])

    def drive(self) -> list[str]:
        """Command and force of the joint's drives, if they vary."""
        drives = [d.name for d in self.screen.motion.scene.drives if d.joint == self.joint]
        return self._varying([f"{k}/{d}" for d in drives for k in ("ctrl", "force")])

    def _varying(self, names: Sequence[str]) -> list[str]:
        return [n for n in names if self.span(n)[1] - self.span(n)[0] > 1e-6]

    def centres(self, name: str) -> Float[np.ndarray, " centre"]:
        """Evenly spaced centres of bumps over what a column covers."""
        low, high = np.quantile(self.column(name), [0.005, 0.995])
        # fine bumps in time would interpolate between blocks whatever drifts
        return np.linspace(low, high, 3 if name == "t" else self._bumps)

    def features(
        self, names: Sequence[str], terms: Sequence[Term]
    ) -> Float[np.ndarray, "row term"]:
        """Terms in the weak form."""
        return np.asarray(self._terms.weak(names, terms)[self.rows])

    def law(
        self,
        names: Sequence[str],
        terms: Sequence[Term],
        weights: Float[np.ndarray, " term"],
        beyond: float = 0.0,
    ) -> Law:
        """A law of terms over the range that was seen, of all but positions widened by a share.

        What only turns with time goes on turning.
        """
        low, high = np.array([self.span(n) for n in names]).T
        wider = beyond * (high - low) * [not n.startswith("qpos/") for n in names]
        kinds = [{a.kind for t in terms for a in t if a.column == i} for i in range(len(names))]
        turns = [n == "t" and k <= {"sin", "cos"} for n, k in zip(names, kinds, strict=True)]
        wider = np.where(turns, np.inf, wider)
        return Law(tuple(names), low - wider, high + wider, tuple(terms), weights)


@dataclass(frozen=True, eq=False)
class LawFit:
    """A regression on some columns.

    Attributes:
        names: the columns.
        terms: products of functions of columns, in which it is linear.
        ridge: the penalty that predicts best.
        left: error of predicting each row without having seen its block [N·m].
        error: its square, summed over each block.
        r2: predicted share of the force's square.
    """

    names: tuple[str, ...]
    terms: tuple[Term, ...]
    ridge: float
    left: Float[np.ndarray, " row"]
    error: Float[np.ndarray, " block"]
    r2: float


def smooth_terms(data: ForceData, names: Sequence[str]) -> list[Term]:
    """Bumps along each column, alone and times simple functions of each other column."""
    alone: list[list[Term]] = []
    for i, name in enumerate(names):
        centres = data.centres(name)
        width = 1.2 * float(centres[1] - centres[0])
        bumps: list[Term] = [(Atom(i, "bump", float(c), width),) for c in centres]
        alone.append([*bumps, *((a,) for a in simple(data, i, name))])
    terms = [term for column_terms in alone for term in column_terms]
    for i, j in itertools.permutations(range(len(names)), 2):
        bumps = [t for t in alone[i] if t[0].kind == "bump"]
        terms += [(*t, a) for t in bumps for a in simple(data, j, names[j])]
    return [(), *terms]


def simple(data: ForceData, index: int, name: str) -> list[Atom]:
    """Factors of another column's bumps: the value, and for velocities its sign."""
    atoms = [Atom(index, "linear")]
    if name.startswith("qvel/"):
        atoms.append(Atom(index, "sign", 0.0, data.ease))
    return atoms


def crossval(
    data: ForceData, names: Sequence[str], terms: Sequence[Term], penalise: bool = True
) -> LawFit:
    """Predict every block from the other folds; the best ridge."""
    f, y = data.features(names, terms), data.force
    size = np.sqrt(np.mean(f**2, axis=0)) + 1e-12
    f = f / size
    ridges = np.array(_RIDGES if penalise else _NEXT_TO_NONE) * len(y)
    left = np.zeros((len(ridges), len(y)))
    folds = [data.fold == k for k in range(FOLDS)]
    # a fold's normal equations are those of all less its own
    grams = [f[test].T @ f[test] for test in folds]
    moments = [f[test].T @ y[test] for test in folds]
    gram, moment = np.sum(grams, axis=0), np.sum(moments, axis=0)
    for test, own_gram, own_moment in zip(folds, grams, moments, strict=True):
        others, seen = gram - own_gram, moment - own_moment
        penalty = np.eye(len(others))
        weights = [cho_solve(cho_factor(others + r * penalty), seen) for r in ridges]
        left[:, test] = y[test] - np.stack(weights) @ f[test].T
    best = int(np.argmin((left**2).sum(axis=1)))
    error = np.bincount(data.block, left[best] ** 2)
    r2 = 1.0 - float(error.sum() / max((y**2).sum(), 1e-300))
    return LawFit(tuple(names), tuple(terms), float(ridges[best]), left[best], error, r2)


def solve(data: ForceData, fit: LawFit, beyond: float = 0.0) -> Law:
    """The law of a regression, from all rows; ``beyond`` as in :meth:`ForceData.law`."""
    f = data.features(fit.names, fit.terms)
    size = np.sqrt(np.mean(f**2, axis=0)) + 1e-12
    gram = (f / size).T @ (f / size) + fit.ridge * np.eye(len(size))
    weights = np.linalg.solve(gram, (f / size).T @ data.force) / size
    return data.law(fit.names, fit.terms, weights, beyond)
