"""What nothing explains is said of the places that bear most of it."""

from __future__ import annotations

from wt.diagnose.selection.verdict import bearing


def test_the_fewest_that_bear_most_are_named_the_largest_first() -> None:
    shares = {"hip": 0.25, "knee": 0.4, "abduct": 0.2, "other": 0.1, "last": 0.05}
    assert bearing(shares, 0.8) == ("knee", "hip", "abduct")


def test_one_that_bears_it_alone_is_named_alone() -> None:
    assert bearing({"hip": 0.1, "knee": 0.9}, 0.8) == ("knee",)
    assert bearing({}, 0.8) == ()
