"""Terms along a motion in the weak form of its forces, each computed once.

A regression on two columns has the terms of each of them, a formula's last term is moved beside the
same others, and what is learned beside one set of effects is learned beside the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from wt.diagnose.residual.screen import Screen
from wt.diagnose.unknown.law import Atom, Term
from wt.diagnose.unknown.memory import along

_BYTES, _LEAST = 2**26, 256
"""What is kept at most of weak terms, and of columns and their functions; and how many at least."""

Factors = tuple[tuple[str, Atom], ...]
"""A term with the names of its columns."""


class WeakTerms:
    """Functions of a screen's columns, and products of them in the weak form: the latest asked."""

    def __init__(self, screen: Screen) -> None:
        """Know nothing yet."""
        self._screen = screen
        self._most = max(_LEAST, _BYTES // (8 * len(screen.rows)))
        kept = max(_LEAST, _BYTES // (8 * len(screen.motion)))
        self.column = lru_cache(maxsize=kept)(self._column)
        self._value = lru_cache(maxsize=kept)(self._function)
        self._known: dict[Factors, Float[np.ndarray, " row"]] = {}

    def _column(self, name: str) -> Float[np.ndarray, " sample"]:
        """Values along the motion."""
        return along(self._screen.motion, [name])[:, 0]

    def _function(self, name: str, atom: Atom) -> Float[np.ndarray, " sample"]:
        """A function of a column along the motion; many terms have it as a factor."""
        return np.asarray(atom.value(self.column(name)))

    def weak(self, names: Sequence[str], terms: Sequence[Term]) -> Float[np.ndarray, "row term"]:
        """Terms in the weak form.

        Args:
            names: of their columns.
            terms: products of functions of these.
        """
        every = [tuple((names[a.column], replace(a, column=0)) for a in term) for term in terms]
        here = {term: self._known.pop(term) for term in every if term in self._known}
        new = [term for term in dict.fromkeys(every) if term not in here]
        if new:
            values = np.ones((len(self._screen.motion), len(new)))
            for k, term in enumerate(new):
                for factor in term:
                    values[:, k] *= self._value(*factor)
            weak = self._screen.weak(values)
            here |= {term: weak[:, k].copy() for k, term in enumerate(new)}
        self._known |= here  # the latest come last
        for oldest in list(self._known)[: -self._most]:
            del self._known[oldest]
        out = np.empty((len(self._screen.rows), len(every)))
        for k, term in enumerate(every):
            out[:, k] = here[term]
        return out


@lru_cache(maxsize=2)  # a diagnosis has one screen, or two in turn
def weak_terms(screen: Screen) -> WeakTerms:
    """Those of a screen, for all that is learned on it."""
    return WeakTerms(screen)
