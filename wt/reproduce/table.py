"""Single-step errors of all tasks in one table and figure, the paper's beside ours (figure 3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from wt.evaluate.results import OURS, PAPERS_OWN, Results
from wt.reproduce.tasks import Task
from wt.show import colors
from wt.show.text import short

METHODS = (
    "RawSim", "DirectPred", "RSSM", "ResDyn", "ResDynSim", "MeanShiftOT", PAPERS_OWN, OURS,
)  # fmt: skip
"""Rows of the table and bars of the figure, in the paper's order; then what it does not have."""
PAPER = "paper's"
_DARK = "#222222"

Found = Mapping[Task, Results]


def head(found: Found) -> list[str]:
    """Columns of the table."""
    columns = ["method / RawSim"]
    for task in found:
        columns += [f"{task.robot.split()[0]} {task.condition}", PAPER]
    return columns


def rows(found: Found) -> list[list[str]]:
    """Error of each method in units of RawSim's, with its spread; then our ratio to the best.

    Absolute errors of different worlds cannot be compared; ratios to the simulator can.
    """
    table = []
    for method in METHODS:
        if any(method in results.single_step for results in found.values()):
            cells = [_cells(results, method) for results in found.values()]
            table.append([method, *(cell for pair in cells for cell in pair)])
    table.append([f"{OURS} / best baseline"])
    for results in found.values():
        known = results.paper
        others = [known[m] for m in known if m != PAPERS_OWN]
        theirs = short(known[PAPERS_OWN] / min(others)) if others else "–"
        table[-1] += [short(results.ratio_to_best_baseline), theirs]
    return table


def _cells(results: Results, method: str) -> tuple[str, str]:
    """Ours and the paper's."""
    paper = results.paper
    theirs = short(paper[method] / paper["RawSim"]) if method in paper else "–"
    if method not in results.single_step:
        return "–", theirs
    raw = results.single_step["RawSim"].mse if "RawSim" in results.single_step else math.nan
    spread = results.single_step[method].std / raw if len(results.seeds) > 1 else 0.0
    return short(results.relative(method)) + (f" ± {spread:.1g}" if spread else ""), theirs


def figure(found: Found) -> Figure:
    """Bars of each method, a panel a robot and a group a condition; the paper's are diamonds."""
    robots = list(dict.fromkeys(task.robot for task in found))
    drawn = Figure(figsize=(1.6 + 3.4 * len(robots), 4.2), layout="constrained")
    panels = drawn.subplots(1, len(robots), sharey=True, squeeze=False)[0]
    for axes, robot in zip(panels, robots, strict=True):
        tasks = [task for task in found if task.robot == robot]
        for i, method in enumerate(METHODS):
            shift = 0.84 * ((i + 0.5) / len(METHODS) - 0.5)
            places = np.arange(len(tasks)) + shift
            ours = [_relative(found[task], method) for task in tasks]
            color = tuple(c / 255 for c in colors.of_method(method))
            axes.bar(places, ours, width=0.84 / len(METHODS), color=color, label=method)
            theirs = [_papers(found[task], method) for task in tasks]
            axes.plot(
                places, theirs, "D", color="white", markeredgecolor=_DARK, markersize=4.5,
                label="in the paper" if method == METHODS[0] else None,
            )  # fmt: skip
        axes.axhline(1.0, color=_DARK, linewidth=0.8)
        axes.set_yscale("log")
        axes.set_xticks(range(len(tasks)), [task.condition for task in tasks])
        axes.set_title(robot, loc="left")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", color="#e6e6e6", linewidth=0.8)
        axes.set_axisbelow(True)
    panels[0].set_ylabel("single-step MSE, in units of RawSim's")
    handles, labels = panels[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return drawn


def _relative(results: Results, method: str) -> float:
    return results.relative(method) if method in results.single_step else math.nan


def _papers(results: Results, method: str) -> float:
    paper = results.paper
    return paper[method] / paper["RawSim"] if method in paper else math.nan


def missing(tasks: Sequence[Task]) -> str:
    """One line on tasks whose configuration is not there; empty if there are none."""
    names = ", ".join(task.name for task in tasks)
    return f"Not run, for want of a configuration: {names}." if tasks else ""
