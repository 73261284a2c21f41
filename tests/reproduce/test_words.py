from __future__ import annotations

import math

import pytest

from wt.reproduce.words import gain, mean, order, spread


def test_spread_is_the_standard_deviation_of_the_sample() -> None:
    assert spread([1.0, 2.0, 3.0]) == "2 ± 1"
    assert spread([0.25]) == "0.25"
    assert spread([]) == "–"
    assert math.isnan(mean([]))


def test_order_says_where_ours_differs() -> None:
    papers = {"a": 1.0, "b": 2.0, "not ours": 0.0}
    assert order({"a": 5.0, "b": 6.0, "new": 1.0}, papers, "Error") == (
        "Error: the paper's order, a < b."
    )
    assert order({"a": 5.0, "b": 4.0}, papers, "Error") == "Error: b < a; in the paper a < b."


def test_gain_is_taken_seed_by_seed() -> None:
    assert gain([1.0, 2.0], [0.5, 1.2]) == "45.0 % less ± 7.1 %"
    assert gain([1.0], [1.1]) == "10.0 % more (one seed)"
    with pytest.raises(ValueError, match="longer"):
        gain([1.0], [1.0, 2.0])
