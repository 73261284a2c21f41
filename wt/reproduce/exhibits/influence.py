"""Figure 3, an experiment: how much is hidden in a transition decides which method is ahead."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from wt.evaluate import paper
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.evaluate.single_step import errors
from wt.reproduce.bench import FULL, PLUS, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.tasks import WALKING
from wt.reproduce.words import UNITS, keep_errors, mean, order, spread
from wt.show import colors
from wt.types import Pairs

BASELINES = ("RawSim", "DirectPred", "RSSM", "ResDyn")
"""Those of the paper."""
SHARES = {"least half": (0.0, 0.5), "50–75 %": (0.5, 0.75), "75–90 %": (0.75, 0.9),
          "90–99 %": (0.9, 0.99), "top 1 %": (0.99, 1.0)}  # fmt: skip
"""Parts of the test pairs, ordered by how much is hidden in them: from … to."""
LEAST, MOST = "least half", "top 1 %"

Errors = Mapping[str, Mapping[str, Mapping[str, list[float]]]]
"""Errors by method, part and unit, one a seed."""


@register
class Influence(Exhibit):
    """Single-step error of the walking robots by how much of a step is hidden."""

    name = "influence"
    order = 16
    title = "Figure 3, an experiment: steps in which much is hidden"
    tasks = WALKING
    any_task = True

    def measure(self, bench: Bench) -> Numbers:
        """Split the test pairs of each task, with the models of its run of figure 3."""
        return {
            task.name: _by_part(bench, task.name) for task in bench.tasks if task.name in self.tasks
        }

    def present(self, numbers: Numbers) -> Section:
        """A table a task, and the order of the paper's methods at both ends."""
        grids, lines = [], []
        for task, parts in numbers.items():
            for unit, column in UNITS.items():
                rows = [
                    [name, *(spread(found[unit]) for found in values.values())]
                    for name, values in parts.items()
                ]
                grids.append(Grid([f"{column}, {task}", *SHARES], rows))
            known = paper.SINGLE_STEP[task]
            for part in (LEAST, MOST):
                ours = {name: mean(values[part]["mse"]) for name, values in parts.items()}
                lines.append(order(ours, known, f"{task}, {part}"))
        return Section(
            "Test pairs ordered by how far S's answer is from the one that it gives with nothing "
            "hidden, in R's standard deviations: by what is hidden in them, and by no method's "
            "error.",
            grids,
            {"influence": _figure(numbers)},
            lines,
        )


def influence(pairs: Pairs, scale: Float[np.ndarray, " state"]) -> Float[np.ndarray, " pair"]:
    """Influence of h on each step: mean squared difference of S's answers with and without it.

    Args:
        pairs: R's transitions and S's answers.
        scale: standard deviations of the state.

    Returns:
        One number a pair, in units of R's variance.
    """
    shift: Float[np.ndarray, "pair state"] = (pairs.sim_next - pairs.real.nominal) / scale
    return np.mean(np.square(shift, dtype=np.float64), axis=1)


def _by_part(bench: Bench, task: str) -> Errors:
    study = bench.study(task)
    bench.train(study, [FULL, PLUS], BASELINES)
    test, scale = study.data.test, study.scales.state
    rows = np.argsort(influence(test, scale), kind="stable")
    by_name: dict[str, dict[str, dict[str, list[float]]]] = {}
    for name in (*BASELINES, PAPERS_OWN, OURS):
        for seed in study.config.seeds:
            predicted = study.prediction(seed, name)
            for part, (low, high) in SHARES.items():
                those = rows[int(low * len(rows)) : int(high * len(rows))]
                part_of_test = Pairs(test.real.select(those), test.sim_next[those])
                found = errors(predicted[those], part_of_test, study.scales)
                keep_errors(by_name.setdefault(name, {}).setdefault(part, {}), found)
    return by_name


def _figure(by_task: Mapping[str, Errors]) -> Figure:
    drawn = Figure(figsize=(2.4 + 2.6 * len(by_task), 4.0), layout="constrained")
    panels = drawn.subplots(1, len(by_task), sharey=True, squeeze=False)[0]
    for axes, (task, parts) in zip(panels, by_task.items(), strict=True):
        for name, values in parts.items():
            color = tuple(c / 255 for c in colors.of_method(name))
            mse = [mean(found["mse"]) for found in values.values()]
            axes.plot(mse, "o-", color=color, label=name)
        axes.set_yscale("log")
        axes.set_xticks(range(len(SHARES)), list(SHARES), rotation=30)
        axes.set_title(task, loc="left")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("single-step MSE")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3,
                 frameon=False)  # fmt: skip
    return drawn
