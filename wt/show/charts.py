"""Line charts as SVG, drawn by hand so that a page needs no library and no network.

A chart has no colours of its own: each series carries a CSS class, so that the page decides, in
light and dark. Long lines are thinned to their envelope, which no eye can tell from the original.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Num

from wt.show.text import short

Scale = Callable[[np.ndarray], np.ndarray]
"""Takes values of an axis to coordinates of the page."""

Mark = Literal["line", "dots", "beads"]
"""A line, a cloud of points, or a line with a bead at each point."""

WIDTH, HEIGHT = 440.0, 240.0
"""About as wide as on a phone: letters are neither tiny there nor huge on a screen."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 66.0, 16.0, 30.0, 46.0
_MOST_X, _MOST_Y = 6, 6  # ticks
_COLUMNS = 300  # of a line's envelope
_DOTS = 500


@dataclass(frozen=True, eq=False)
class Series:
    """One quantity over x.

    Attributes:
        css: class that gives it its colour, e.g. ``"before"``.
        x: places of the points, increasing where ``mark`` is a line.
        y: their values, NaN where there is nothing to draw.
        mark: style of the drawing.
    """

    css: str
    x: Num[np.ndarray, " point"]
    y: Num[np.ndarray, " point"]
    mark: Mark = "line"


@dataclass(frozen=True)
class Axes:
    """Labels and scales of a chart.

    Attributes:
        x: label below, with its unit.
        y: label above, with its unit: as long as names of joints are, it would not fit beside.
        alt: description for readers who hear the chart instead of seeing it.
        log: whether both scales are logarithmic.
        spans: (start, end) pairs along x that are shaded.
        floor: half height of a band around zero, or None; below it is only noise.
    """

    x: str
    y: str
    alt: str
    log: bool = False
    spans: tuple[tuple[float, float], ...] = ()
    floor: float | None = None


def chart(series: Sequence[Series], axes: Axes) -> str:
    """One chart as an ``<svg>`` element; series that come later lie on top."""
    drawn = [s for s in series if np.isfinite(s.y).any()]
    x0, x1 = _limits([s.x[np.isfinite(s.y)] for s in drawn], axes.log, 0.0)
    heights = [s.y for s in drawn]
    if axes.floor is not None:
        heights.append(np.array([-axes.floor, axes.floor]))
    y0, y1 = _limits(heights, axes.log, 0.06)
    to_x = _scale(x0, x1, _LEFT, WIDTH - _RIGHT, axes.log)
    to_y = _scale(y0, y1, HEIGHT - _BOTTOM, _TOP, axes.log)
    parts = [
        f'<svg class="chart" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="{html.escape(axes.alt)}">',
        *_spans(axes, to_x, (x0, x1)),
        *_floor(axes, to_y),
        *_grid(axes, (x0, x1, y0, y1), to_x, to_y),
    ]
    for s in drawn:
        x, y = (s.x, s.y) if s.mark == "beads" else _thin(s)
        if axes.log:
            x, y = np.maximum(x, x0), np.maximum(y, y0)  # what has no logarithm lies on the edge
        parts.append(_marked(s, to_x(x), to_y(y)))
    return "".join(parts) + "</svg>"


def ticks(low: float, high: float, most: int = 6) -> Float[np.ndarray, " tick"]:
    """Round numbers (1, 2 or 5 times a power of ten) between two ends, at most ``most`` of them."""
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    for step in (power * m for m in (1, 2, 5, 10, 20)):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first < most:
            break
    return step * np.arange(first, last + 1)


def _limits(
    values: Sequence[Num[np.ndarray, " _"]], log: bool, margin: float
) -> tuple[float, float]:
    drawable = [v[np.isfinite(v)] for v in values]
    if log:
        drawable = [v[v > 0] for v in drawable]
    drawable = [v for v in drawable if v.size]
    if not drawable:
        return (0.1, 1.0) if log else (0.0, 1.0)
    low, high = min(float(v.min()) for v in drawable), max(float(v.max()) for v in drawable)
    if log:
        grown = max(math.log10(high / low), 0.3) * max(margin, 0.02)
        return low / 10**grown, high * 10**grown
    if high - low < 1e-12 * max(1.0, abs(high)):
        low, high = low - 0.5, high + 0.5
    grown = margin * (high - low)
    return low - grown, high + grown


def _scale(low: float, high: float, start: float, end: float, log: bool) -> Scale:
    def to_page(value: Num[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
        if log:
            value, a, b = np.log10(value), math.log10(low), math.log10(high)
        else:
            a, b = low, high
        return start + (np.asarray(value) - a) / (b - a) * (end - start)

    return to_page


def _spans(axes: Axes, to_x: Scale, ends: tuple[float, float]) -> list[str]:
    shades = []
    for span in axes.spans:
        a, b = to_x(np.clip(np.array(span), *ends))
        if b > a:
            shades.append(
                f'<rect class="span" x="{a:.1f}" y="{_TOP:g}" width="{max(b - a, 1.5):.1f}" '
                f'height="{HEIGHT - _TOP - _BOTTOM:g}"/>'
            )
    return shades


def _floor(axes: Axes, to_y: Scale) -> list[str]:
    if axes.floor is None:
        return []
    bottom, top = to_y(np.array([-axes.floor, axes.floor]))
    return [
        f'<rect class="floor" x="{_LEFT:g}" y="{top:.1f}" '
        f'width="{WIDTH - _LEFT - _RIGHT:g}" height="{bottom - top:.1f}"/>'
    ]


def _grid(
    axes: Axes,
    limits: tuple[float, float, float, float],
    to_x: Scale,
    to_y: Scale,
) -> list[str]:
    x0, x1, y0, y1 = limits
    parts = []
    bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
    for value, y in _placed(_values(y0, y1, axes.log, _MOST_Y), to_y):
        css = "zero" if value == 0 else "grid"
        parts.append(f'<path class="{css}" d="M{_LEFT:g} {y:.1f}H{right:g}"/>')
        parts.append(f'<text class="y" x="{_LEFT - 6:g}" y="{y + 4:.1f}">{_label(value)}</text>')
    for value, x in _placed(_values(x0, x1, axes.log, _MOST_X), to_x):
        parts.append(f'<path class="grid" d="M{x:.1f} {bottom:g}v4"/>')
        parts.append(f'<text class="x" x="{x:.1f}" y="{bottom + 18:g}">{_label(value)}</text>')
    middle = (_LEFT + right) / 2
    label = f'<text class="x label" x="{middle:g}" y="{HEIGHT - 5:g}">{html.escape(axes.x)}</text>'
    above = f'<text class="label" x="0" y="14">{html.escape(axes.y)}</text>'
    return [*parts, label, above]


def _values(low: float, high: float, log: bool, most: int) -> Float[np.ndarray, " tick"]:
    if not log:
        return ticks(low, high, most)
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1, 2, 5), (1, 3), (1,)):
        values = [m * 10.0**p for p in powers for m in steps if low <= m * 10.0**p <= high]
        if len(values) <= most:
            break
    if len(values) < 3:  # less than a decade
        values = [
            m * 10.0**p for p in powers for m in (1, 2, 3, 5, 7) if low <= m * 10.0**p <= high
        ]
    return np.array(values)


def _placed(values: Float[np.ndarray, " tick"], to_page: Scale) -> list[tuple[float, float]]:
    return list(zip(values.tolist(), to_page(values).tolist(), strict=True)) if values.size else []


def _label(value: float) -> str:
    return "0" if abs(value) < 1e-14 else short(value).replace("-", "−")


def _thin(series: Series) -> tuple[Num[np.ndarray, " point"], Num[np.ndarray, " point"]]:
    """A line's envelope, or evenly chosen dots: few enough points for a page."""
    x, y = series.x, series.y
    if series.mark == "dots":
        step = max(1, -(-len(x) // _DOTS))
        return x[::step], y[::step]
    if len(x) <= 2 * _COLUMNS:
        return x, y
    rows: list[int] = []
    for part in np.array_split(np.arange(len(x)), _COLUMNS):
        if np.isfinite(y[part]).any():
            ends = {int(part[np.nanargmin(y[part])]), int(part[np.nanargmax(y[part])])}
            rows += sorted(ends)
        else:
            rows.append(int(part[0]))
    rows.append(len(x) - 1)
    return x[rows], y[rows]


def _marked(series: Series, x: Float[np.ndarray, " point"], y: Float[np.ndarray, " point"]) -> str:
    """One ``<path>``; a gap where y is not finite."""
    points = [
        f"{a:.1f} {b:.1f}" if math.isfinite(b) else ""
        for a, b in zip(x.tolist(), y.tolist(), strict=True)
    ]
    if series.mark == "dots":
        d = "".join(f"M{p}h0" for p in points if p)
        return f'<path class="dots {series.css}" d="{d}"/>'
    d, pen = "", "M"
    for p in points:
        d += pen + p if p else ""
        pen = "L" if p else "M"
    line = f'<path class="line {series.css}" d="{d}"/>'
    if series.mark == "beads":
        beads = "".join(f"M{p}h0" for p in points if p)
        line += f'<path class="beads {series.css}" d="{beads}"/>'
    return line
