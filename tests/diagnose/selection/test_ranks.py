"""The signed-rank test says what scipy's does, without trying every choice of signs."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.stats import wilcoxon

from wt.diagnose.selection.ranks import signed_rank


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("zeros", [0, 2])
@pytest.mark.parametrize("count", [4, 9, 14, 30])
def test_as_scipy(count: int, zeros: int, ties: bool) -> None:
    for seed in range(2):
        difference = np.random.default_rng(seed).normal(0.5, size=count)
        difference[count - zeros :] = 0.0
        if ties:
            difference[0] = -difference[1]
        want = wilcoxon(difference, alternative="greater").pvalue
        assert signed_rank(difference) == pytest.approx(want, rel=1e-12)


def test_ties_cost_nothing() -> None:
    difference = np.random.default_rng(0).normal(size=13)
    difference[0] = difference[1]
    begun = time.process_time()
    signed_rank(difference)
    assert time.process_time() - begun < 0.1
