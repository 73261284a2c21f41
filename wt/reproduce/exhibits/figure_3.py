"""Figure 3: single-step errors of all tasks, the paper's beside ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure

from wt.evaluate.results import ASSUMPTION, CEILING, ENCODER, OURS, PAPERS_OWN, Results
from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.tasks import TASKS, PaperTask
from wt.reproduce.words import order
from wt.show import colors
from wt.show.text import short

METHODS = (
    "RawSim", "DirectPred", "RSSM", "ResDyn", "ResDynSim", "MeanShiftOT", "DeltaAction",
    "FlowTranslation", PAPERS_OWN, ENCODER, OURS, CEILING,
)  # fmt: skip
"""Rows of the table and bars of the figure, in the paper's order; then what it does not have."""
PAPER = "paper's"
_DARK = "#222222"

ResultsByTask = Mapping[PaperTask, Results]


@register
class SingleStep(Exhibit):
    """Every method on every task, by the code of ``wt fit``."""

    name = "figure-3"
    order = 10
    title = "Single-step prediction on the paper's tasks (figure 3)"
    tasks = tuple(task.name for task in TASKS)
    any_task = True

    def measure(self, bench: Bench) -> Numbers:
        """The results of each task's run."""
        return {task.name: bench.results(task).to_json() for task in bench.tasks}

    def present(self, numbers: Numbers) -> Section:
        """One table and figure, in units of RawSim's error."""
        results = {
            task: Results.from_json(numbers[task.name]) for task in TASKS if task.name in numbers
        }
        return Section(
            "MSE of the normalised next state under teacher forcing, in units of RawSim's; mean "
            f"and spread over seeds. {ASSUMPTION}",
            [Grid(head(results), rows(results)), *_units(results)],
            {"single_step": figure(results), **_figures(results)},
            [
                *_remarks(results),
                *(_difference(task, one) for task, one in results.items()),
                *_selected(results),
                *_models(results),
            ],
        )


def _units(by_task: ResultsByTask) -> list[Grid]:
    """The same errors in the other units: of the state and its change, and physical."""
    grids = []
    for task, results in by_task.items():
        scores = results.single_step
        table = [[m, short(scores[m].mse), short(scores[m].mse_change)] for m in scores]
        place = f"{task.robot}, {task.condition}"
        grids.append(Grid(["method", "MSE of the state", "of its change"], table, place))
        if results.extraction:
            grids.append(Grid(*results.extracted(), f"{place}: what features keep"))
        if results.channels:
            grids.append(Grid(*results.physical(), f"{place}: RMSE"))
    return grids


def _difference(task: PaperTask, results: Results) -> str:
    ours = {
        m: results.relative(m) for m in results.single_step if m not in (OURS, ENCODER, CEILING)
    }
    papers = {m: _papers(results, m) for m in results.paper}
    best = f" {OURS} makes {short(results.ratio_to_best_baseline)} of the best baseline's error."
    return order(ours, papers, f"{task.robot}, {task.condition}") + best


def _figures(by_task: ResultsByTask) -> dict[str, Figure]:
    """The same bars in the other units."""
    return {
        "single_step_change": figure(by_task, "single-step MSE of the change", _of_change),
        "single_step_physical": figure(
            by_task, "single-step MSE in rad, rad/s and so on", Results.physical_mse
        ),
    }


def _remarks(by_task: ResultsByTask) -> list[str]:
    """What rows of the table are marked for, each once."""
    places: dict[str, list[str]] = {}
    for task, results in by_task.items():
        for method, remark in results.remarks.items():
            line = f"* {method}: {remark}"
            places.setdefault(line, []).append(f"{task.robot}, {task.condition}")
    return [f"{line} ({'; '.join(where)})" for line, where in places.items()]


def _selected(by_task: ResultsByTask) -> list[str]:
    """What selected the models."""
    return list(dict.fromkeys(results.selected for results in by_task.values()))


def _models(by_task: ResultsByTask) -> list[str]:
    kept = [f"{r.model}/{r.version}" for r in by_task.values() if r.model]
    return [f"Registered: {', '.join(kept)}."] if kept else []


def head(by_task: ResultsByTask) -> list[str]:
    """Columns of the table."""
    columns = ["method / RawSim"]
    for task in by_task:
        columns += [f"{task.robot.split()[0]} {task.condition}", PAPER]
    return columns


def rows(by_task: ResultsByTask) -> list[list[str]]:
    """Error of each method in units of RawSim's, with its spread; then our ratio to the best.

    Absolute errors of different worlds cannot be compared; ratios to the simulator can.
    """
    table = []
    for method in METHODS:
        if any(method in results.single_step for results in by_task.values()):
            cells = [_cells(results, method) for results in by_task.values()]
            table.append([method, *(cell for pair in cells for cell in pair)])
    table.append([f"{OURS} / best baseline"])
    for results in by_task.values():
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
    mark = "*" * (method in results.remarks)
    return short(results.relative(method)) + (f" ± {spread:.1g}" if spread else "") + mark, theirs


Unit = Callable[[Results, str], float]
"""A method's error in one unit."""


def _of_state(results: Results, method: str) -> float:
    return results.single_step[method].mse


def _of_change(results: Results, method: str) -> float:
    return results.single_step[method].mse_change


def figure(by_task: ResultsByTask, what: str = "single-step MSE", unit: Unit = _of_state) -> Figure:
    """Bars of each method, a panel a robot and a group a condition; the paper's are diamonds.

    Args:
        by_task: results.
        what: stands beside the axis.
        unit: of the errors, which are drawn in units of RawSim's; the paper's, whose unit is not
            known, stand beside those of the state.
    """
    robots = list(dict.fromkeys(task.robot for task in by_task))
    drawn = Figure(figsize=(1.6 + 3.4 * len(robots), 4.2), layout="constrained")
    panels = drawn.subplots(1, len(robots), sharey=True, squeeze=False)[0]
    for axes, robot in zip(panels, robots, strict=True):
        tasks = [task for task in by_task if task.robot == robot]
        for i, method in enumerate(METHODS):
            shift = 0.84 * ((i + 0.5) / len(METHODS) - 0.5)
            places = np.arange(len(tasks)) + shift
            ours = [_relative(by_task[task], method, unit) for task in tasks]
            color = tuple(c / 255 for c in colors.of_method(method))
            axes.bar(places, ours, width=0.84 / len(METHODS), color=color, label=method)
            if unit is _of_state:
                theirs = [_papers(by_task[task], method) for task in tasks]
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
    panels[0].set_ylabel(f"{what}, in units of RawSim's")
    handles, labels = panels[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return drawn


def _relative(results: Results, method: str, unit: Unit) -> float:
    """A method's error in units of RawSim's; NaN where either is not known."""
    if not {method, "RawSim"} <= set(results.single_step):
        return math.nan
    raw = unit(results, "RawSim")
    return unit(results, method) / raw if raw else math.nan


def _papers(results: Results, method: str) -> float:
    paper = results.paper
    return paper[method] / paper["RawSim"] if method in paper else math.nan
