"""Charts: round ticks, nothing outside the page, no peak lost, gaps and logarithms."""

from __future__ import annotations

import re

import numpy as np

from wt.show.charts import HEIGHT, WIDTH, Axes, Series, chart, ticks


def lines(svg: str) -> list[str]:
    return re.findall(r'class="line \w+" d="([^"]*)"', svg)


def test_ticks_are_round_and_inside() -> None:
    assert ticks(-13.4, 14.1).tolist() == [-10, -5, 0, 5, 10]
    np.testing.assert_allclose(ticks(0.031, 0.094), [0.04, 0.05, 0.06, 0.07, 0.08, 0.09])


def test_a_chart_keeps_peaks_that_thinning_could_lose() -> None:
    x = np.linspace(0.0, 1.0, 20_000)
    y = np.zeros_like(x)
    y[12_345] = 1.0
    svg = chart([Series("before", x, y)], Axes("x", "y", "a spike"))
    d = re.search(r'class="line before" d="([^"]+)"', svg)
    assert d is not None
    points = np.array([p.split() for p in re.split("[ML]", d[1])[1:]], float)
    assert len(points) < 1000
    assert (points >= 0).all()
    assert (points <= [WIDTH, HEIGHT]).all()
    high = points[points[:, 1].argmin()]
    base = points[0]
    assert base[1] - high[1] > 0.8 * (HEIGHT - 76)
    np.testing.assert_allclose(
        (high[0] - base[0]) / (points[-1, 0] - base[0]), 12_345 / 19_999, atol=1e-3
    )


def test_equal_ratios_are_equally_far_apart_on_logarithmic_axes() -> None:
    x = np.array([0.1, 1.0, 10.0])
    (d,) = lines(chart([Series("after", x, x**2, "beads")], Axes("x", "y", "a", log=True)))
    points = np.array([p.split() for p in re.split("[ML]", d)[1:]], float)
    steps = np.diff(points, axis=0)
    np.testing.assert_allclose(steps[0], steps[1], atol=0.11)


def test_a_gap_is_not_bridged_and_nothing_at_all_is_survived() -> None:
    x = np.arange(5.0)
    axes = Axes("x", "y", "a", spans=((-3.0, 1.0), (8.0, 9.0)), floor=0.5)
    svg = chart([Series("before", x, np.array([0.0, 1.0, np.nan, 1.0, 0.0]))], axes)
    (d,) = lines(svg)
    assert (d.count("M"), d.count("L")) == (2, 2)
    assert svg.count('class="span"') == 1  # the other one is not within the axis
    empty = chart([Series("before", x, np.full(5, np.nan))], Axes("x", "y", "a"))
    assert not lines(empty)
    assert "nan" not in empty


def test_labels_are_escaped() -> None:
    svg = chart([Series("before", np.arange(2.0), np.arange(2.0))], Axes("<x>", "&", '"a"'))
    assert "&lt;x&gt;" in svg
    assert "&amp;</text>" in svg
    assert 'aria-label="&quot;a&quot;"' in svg
