"""Wilcoxon's signed-rank test, fast where differences are few and some of them are alike."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata, wilcoxon

_FEW = 13
"""So few differences, with ties or zeros among them, scipy tries with every choice of signs: most
of a second, where counting how often the ranks add up to what takes no time."""


def signed_rank(difference: Float[np.ndarray, " block"]) -> float:
    """P-value of differences, of which one at least is not zero, being no larger than nothing."""
    moved = difference[difference != 0.0]
    size = np.abs(moved)
    if len(difference) > _FEW or len(np.unique(size)) == len(difference):
        return float(wilcoxon(difference, alternative="greater").pvalue)
    twice = (2.0 * rankdata(size)).astype(int)  # those of ties lie half-way
    ways = np.zeros(twice.sum() + 1)
    ways[0] = 1.0
    for rank in twice:
        ways[rank:] += ways[:-rank].copy()
    return float(ways[twice[moved > 0.0].sum() :].sum() / ways.sum())
