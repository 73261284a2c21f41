"""The numbers as figures, dark on light; each function returns a Figure for the caller to save.

Figures are built without ``pyplot``: no window, no global state, nothing to close.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Real
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wt.evaluate.results import Results
from wt.show import colors
from wt.types import Channel

_DARK = "#222222"
_MARKERS = "osD^vPX<"

Line = tuple[Real[np.ndarray, " _"], Real[np.ndarray, " _"]]
"""The x and y of a line's points; lines may differ in length."""


def bar_table(results: Results) -> Figure:
    """Single-step MSE of each method, smallest on top, with its spread over seeds.

    Bars are in units of RawSim's error where there is one, since that is what can be compared
    with the paper, whose number is a diamond on the method's row; absolute errors stand beside, of
    the state and of its change. :func:`per_channel` has the physical ones.
    """
    scores = results.single_step
    methods = sorted(scores, key=lambda m: (math.isnan(scores[m].mse), scores[m].mse))
    figure, axes = _figure(7.0, 1.2 + 0.42 * len(methods))
    raw = scores["RawSim"].mse if "RawSim" in scores and scores["RawSim"].mse > 0 else None
    unit, paper_unit = raw or 1.0, results.paper.get("RawSim", 1.0) if raw else 1.0
    mse = [np.nan_to_num(scores[m].mse) / unit for m in methods]
    std = [np.nan_to_num(scores[m].std) / unit for m in methods]
    rows = range(len(methods))
    axes.barh(
        rows, mse, xerr=std if len(results.seeds) > 1 else None, height=0.62,
        color=[_rgb(m) for m in methods],
        error_kw={"ecolor": _DARK, "elinewidth": 1.2, "capsize": 3},
    )  # fmt: skip
    known = [
        (results.paper[m] / paper_unit, row) for row, m in enumerate(methods) if m in results.paper
    ]
    if known:
        x, y = zip(*known, strict=True)
        axes.plot(
            x, y, "D", color="white", markeredgecolor=_DARK, markersize=6.5, label="in the paper"
        )
        figure.legend(loc="outside lower right", frameon=False)
    # numbers stand in a column of their own, where no bar or diamond can hide them
    margin = axes.get_yaxis_transform()
    for row, method in enumerate(methods):
        score = scores[method]
        spread = f" ± {score.std:.1g}" if len(results.seeds) > 1 else ""
        value = (
            f"{score.mse:.2g}{spread}; change {score.mse_change:.2g}"
            if math.isfinite(score.mse)
            else "diverged"
        )
        axes.text(1.02, row, value, transform=margin, va="center", fontsize=9, color=_DARK)
    axes.set_yticks(rows, methods)
    axes.invert_yaxis()
    name = "MSE of the normalised next state"
    axes.set_xlabel(f"{name}, in units of RawSim's" if raw else name)
    axes.set_title(f"Single-step prediction, {results.task}", loc="left")
    axes.margins(x=0.04)
    axes.set_xlim(left=0.0)
    axes.grid(axis="y", visible=False)
    return figure


def per_channel(
    rmse: Mapping[str, Float[np.ndarray, " channel"]], channels: tuple[Channel, ...]
) -> Figure:
    """Error of each method on each channel in physical units, one panel a unit, log scale.

    Args:
        rmse: root mean squared errors by method, in the channels' units.
        channels: names and units of the channels.
    """
    units = list(dict.fromkeys(channel.unit for channel in channels))
    figure = Figure(figsize=(9.0, 0.8 + 2.6 * len(units)), layout="constrained")
    panels = figure.subplots(len(units), squeeze=False)[:, 0]
    for axes, unit in zip(panels, units, strict=True):
        where = [c for c, channel in enumerate(channels) if channel.unit == unit]
        for i, (method, errors) in enumerate(rmse.items()):
            # methods stand beside each other within a channel's column
            shift = 0.7 * ((i + 0.5) / len(rmse) - 0.5)
            axes.plot(
                np.arange(len(where)) + shift, np.asarray(errors)[where],
                _MARKERS[i % len(_MARKERS)], color=_rgb(method), label=method, markersize=6.5,
                markeredgecolor="white", markeredgewidth=0.5,
            )  # fmt: skip
        _style(axes)
        axes.set_yscale("log")
        names = [channels[c].name.replace("/", "\n", 1) for c in where]
        axes.set_xticks(range(len(where)), names)
        axes.set_xlim(-0.5, len(where) - 0.5)
        axes.grid(axis="x", visible=False)
        for edge in range(1, len(where)):
            axes.axvline(edge - 0.5, color="#dddddd", linewidth=0.8, zorder=0)
        axes.set_ylabel(f"RMSE [{unit}]")
    figure.align_ylabels()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)
    return figure


def prediction_trace(
    t: Float[np.ndarray, " time"],
    real: Float[np.ndarray, " time"],
    by_method: Mapping[str, Float[np.ndarray, " time"]],
    channel: Channel,
) -> Figure:
    """One channel over time: real and predicted above, the errors below.

    Args:
        t: time stamps [s].
        real: the channel as it was.
        by_method: the channel as each method predicted it.
        channel: its name and unit.
    """
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    above, below = figure.subplots(2, sharex=True, height_ratios=(3, 2))
    above.plot(t, real, color=_DARK, linewidth=2.6, label="real")
    for method, predicted in by_method.items():
        above.plot(t, predicted, color=_rgb(method), linewidth=1.3, label=method)
        below.plot(t, np.asarray(predicted) - real, color=_rgb(method), linewidth=1.1)
    below.axhline(0.0, color=_DARK, linewidth=0.8)
    _style(above)
    _style(below)
    above.set_ylabel(f"{channel.name} [{channel.unit}]")
    below.set_ylabel(f"predicted − real [{channel.unit}]")
    below.set_xlabel("time [s]")
    below.set_xlim(t[0], t[-1])
    figure.align_ylabels()
    figure.legend(loc="outside upper center", ncols=5, frameon=False)
    return figure


def latent_picture(
    s: Float[np.ndarray, "sim plane=2"],
    translated: Float[np.ndarray, "sim plane=2"],
    r: Float[np.ndarray, "real plane=2"],
    axis: str,
) -> Figure:
    """Features of S before and after translation, each over those of R.

    Args:
        s: features of S in the plane.
        translated: the same after translation to R, (N, 2).
        r: features of R, unpaired with the others.
        axis: what the plane is, e.g. ``"UMAP"``.
    """
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    before = ("S", s, colors.S)
    after = ("S translated", translated, colors.TRANSLATED)
    for axes, (name, points, color) in zip(panels, (before, after), strict=True):
        _scatter(axes, r, colors.R, "R", "o")
        _scatter(axes, points, color, name, "^")
        _style(axes)
        axes.set_xlabel(f"{axis} 1")
        legend = axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, markerscale=2.5, frameon=False
        )
        for handle in legend.legend_handles:
            if handle is not None:
                handle.set_alpha(1.0)
    panels[0].set_ylabel(f"{axis} 2")
    panels[0].set_title("before translation", loc="left")
    panels[1].set_title("after translation", loc="left")
    return figure


def curves(
    panels: Sequence[tuple[str, Mapping[str, Line]]], x: str, *, zoom: bool = False
) -> Figure:
    """Lines side by side, a panel a quantity.

    Args:
        panels: label of the y axis, and (x, y) of each line by its name, in every panel.
        x: label of the x axis.
        zoom: whether an axis may cut off lines that are far above the others.
    """
    width = max(7.0, 1.0 + 4.2 * len(panels))
    figure = Figure(figsize=(width, 3.9), layout="constrained")
    drawn = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (label, lines) in zip(drawn, panels, strict=True):
        for name, style in _line_styles(list(lines)).items():
            axes.plot(*lines[name], linewidth=1.6, label=name, **style)
        _style(axes)
        axes.set_xlabel(x)
        axes.set_title(label, loc="left", fontsize=10)
        # what is zero everywhere is a line at the bottom, not in the middle of nothing
        axes.set_ylim(bottom=0.0, top=None if axes.get_ylim()[1] > 0.1 else 0.1)
        if zoom and 0.0 < (top := _upper(lines)) < axes.get_ylim()[1]:
            axes.set_ylim(top=top)
    handles, labels = drawn[0].get_legend_handles_labels()
    # about so many inches for a line's sample and its name
    columns = int(width / (0.6 + 0.085 * max(map(len, labels))))
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(max(1, columns), 5), frameon=False
    )
    return figure


def _upper(lines: Mapping[str, Line]) -> float:
    """Upper end of an axis on which one line far above the others does not flatten them."""
    tops = sorted(float(np.nanmax(y)) for _, y in lines.values() if np.isfinite(y).any())
    return 2.0 * tops[len(tops) // 2] if tops else math.inf


def _line_styles(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """A method's own colour, solid for its first line and dashed for its next ("method, how")."""
    styles: dict[str, dict[str, Any]] = {}
    free = iter(colors.SERIES * len(names))
    seen: set[str] = set()
    for name in names:
        method = name.partition(", ")[0]
        known = colors.of_method(method) != colors.of_method("")
        color = _rgb(method) if known else tuple(c / 255 for c in next(free))
        styles[name] = {"color": color, "linestyle": "--" if known and method in seen else "-"}
        seen.add(method)
    return styles


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    _style(axes)
    return figure, axes


def _style(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e6e6e6", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_DARK, labelsize=9)


def _scatter(
    axes: Axes,
    points: Float[np.ndarray, "point plane=2"],
    color: colors.Color,
    label: str,
    marker: str,
) -> None:
    # more than 2000 points hide each other; an even stride keeps the whole rollout in the picture
    shown = points[:: max(1, math.ceil(len(points) / 2000))]
    axes.plot(
        shown[:, 0], shown[:, 1], marker, color=np.divide(color, 255), label=label,
        markersize=3.5, alpha=0.45, markeredgewidth=0.0, linestyle="none",
    )  # fmt: skip


def _rgb(method: str) -> tuple[float, ...]:
    return tuple(c / 255 for c in colors.of_method(method))
