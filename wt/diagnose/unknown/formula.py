"""A force as a formula of few terms, for people: greedy selection, then centres and widths."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from wt.diagnose.residual.scoring import STRIDE, WINDOW
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.fit import ForceData, LawFit, crossval
from wt.diagnose.unknown.law import Atom, AtomKind, Term

_FAVOUR = 0.9  # a kink must be clearly better than a bump: it changes sign beyond what was seen
_WAVES: tuple[AtomKind, ...] = ("sin", "cos")
_LOCAL: tuple[AtomKind, ...] = ("bump", "kink")


def sparse(data: ForceData, names: Sequence[str], most: int = 4) -> LawFit:
    """A formula of few terms: greedy selection from a library, then centres and widths polished.

    Orthogonal matching pursuit (Y. C. Pati et al., 1993) that stops by Schwarz' criterion.
    """
    y = data.force
    library = _library(data, names)
    columns = data.features(names, library)
    favour = np.array([_FAVOUR if any(a.kind == "kink" for a in t) else 1.0 for t in library])
    chosen: list[Term] = []
    fresh = max(2.0, len(y) * STRIDE / WINDOW)  # neighbouring windows overlap
    error = float(y @ y)
    while len(chosen) < most:
        score = favour * _explained(y, columns, data.features(names, chosen))
        trial = _polish(data, names, [*chosen, library[int(np.argmax(score))]])
        lower = _misfit(data, names, trial)
        price = sum(1 + 2 * (a.kind in ("bump", "kink")) for a in trial[-1]) + 1
        gained = 0.5 * fresh * np.log(error / max(lower, 1e-300)) - 0.5 * price * np.log(fresh)
        if gained < THRESHOLDS.term_nats or error - lower < THRESHOLDS.term_share * float(y @ y):
            break
        chosen, error = trial, lower
    return crossval(data, names, chosen or [()], penalise=False)


def _explained(
    y: Float[np.ndarray, " row"],
    columns: Float[np.ndarray, "row candidate"],
    chosen: Float[np.ndarray, "row chosen"],
) -> Float[np.ndarray, " candidate"]:
    """Squared error that each column would remove beside the chosen ones."""
    basis, _ = np.linalg.qr(chosen)
    left = y - basis @ (basis.T @ y)
    apart = columns - basis @ (basis.T @ columns)
    size, norm = (np.linalg.norm(x, axis=0) for x in (apart, columns))
    new = size > 0.05 * norm + 1e-12
    return np.where(new, (left @ apart) ** 2 / np.maximum(size, 1e-12) ** 2, 0.0)


def reduced(fit: LawFit) -> LawFit:
    """The same regression without columns that no term uses."""
    used = sorted({a.column for t in fit.terms for a in t})
    if not used:
        return fit
    terms = tuple(tuple(replace(a, column=used.index(a.column)) for a in t) for t in fit.terms)
    return replace(fit, names=tuple(fit.names[i] for i in used), terms=terms)


def _library(data: ForceData, names: Sequence[str]) -> list[Term]:
    """Every term that a formula may have: atoms of one column, and products of two columns'."""
    alone = [_atoms(data, i, name) for i, name in enumerate(names)]
    terms: list[Term] = [(), *((a,) for a in itertools.chain.from_iterable(alone))]
    # bumps times bumps would outnumber the rows
    plain = [[a for a in atoms if a.kind not in ("bump", "kink")] for atoms in alone]
    for i, j in itertools.combinations(range(len(names)), 2):
        terms += itertools.product(alone[i], plain[j])
        terms += itertools.product(plain[i], [b for b in alone[j] if b not in plain[j]])
    return terms


def _atoms(data: ForceData, index: int, name: str) -> list[Atom]:
    """Functions of one column: of velocities either side and no bumps, of positions also waves."""
    atoms = [Atom(index, "linear")]
    if name.startswith("qvel/"):
        sides = [Atom(index, "side", 0.0, side) for side in (1.0, -1.0)]
        plain = [Atom(index, "square"), Atom(index, "size"), *sides]
        return [*atoms, Atom(index, "sign", 0.0, data.ease), *plain]
    if name.startswith("qpos/"):
        waves = itertools.product((1, 2, 3, 4, 6), _WAVES)
        atoms += [Atom(index, kind, 0.0, float(n)) for n, kind in waves]
    centres = data.centres(name)
    gap = float(centres[1] - centres[0])
    shapes = itertools.product(_LOCAL, centres, (0.8, 1.6, 3.2))
    return [*atoms, *(Atom(index, kind, float(c), w * gap) for kind, c, w in shapes)]


def _misfit(data: ForceData, names: Sequence[str], terms: Sequence[Term]) -> float:
    f = data.features(names, terms)
    weights, *_ = np.linalg.lstsq(f, data.force, rcond=1e-9)
    left = data.force - f @ weights
    return float(left @ left)


def _polish(data: ForceData, names: Sequence[str], terms: Sequence[Term]) -> list[Term]:
    """Move centres and widths of the last term's bumps or kinks to where they fit best."""
    last = list(terms[-1])
    for k, atom in enumerate(last):
        if atom.kind not in ("bump", "kink"):
            continue
        span = data.span(names[atom.column])

        def moved(
            shift: float,
            stretch: float,
            k: int = k,
            atom: Atom = atom,
            span: tuple[float, float] = span,
        ) -> list[Term]:
            new = replace(
                atom, a=float(np.clip(atom.a + shift * atom.b, *span)), b=atom.b * stretch
            )
            return [*terms[:-1], tuple(new if i == k else x for i, x in enumerate(last))]

        def cost(shift: float, stretch: float, moved: Callable[..., list[Term]] = moved) -> float:
            return _misfit(data, names, moved(shift, stretch))

        best = _search(cost)
        last[k] = moved(*best)[-1][k]
    return [*terms[:-1], tuple(last)]


def _search(cost: Callable[[float, float], float]) -> tuple[float, float]:
    """Pattern search over (shift, stretch) from (0, 1)."""
    here, reach = (0.0, 1.0), (0.4, 1.35)
    value = cost(*here)
    for _ in range(12):
        s, w = here
        trials = [(s - reach[0], w), (s + reach[0], w), (s, w / reach[1]), (s, w * reach[1])]
        values = [cost(*x) for x in trials]
        best = int(np.argmin(values))
        if values[best] < value:
            here, value = trials[best], values[best]
        else:
            reach = (0.5 * reach[0], float(np.sqrt(reach[1])))
    return here
