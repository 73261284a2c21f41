"""Figure 3, an experiment: how much a history could tell at most."""

from __future__ import annotations

from wt.evaluate import paper
from wt.evaluate.single_step import errors
from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.tasks import TASKS
from wt.reproduce.words import gain, mean, spread
from wt.show.text import short

METHODS = ("DirectPred", "RSSM", "PrivilegedPred")


@register
class Privileged(Exhibit):
    """RSSM beside a prediction that is told what RSSM has to infer."""

    name = "privileged"
    order = 18
    title = "Figure 3, an experiment: how much a history could tell"
    tasks = tuple(task.name for task in TASKS)
    any_task = True

    def measure(self, bench: Bench) -> Numbers:
        """Train those three on each task, with every seed."""
        numbers: Numbers = {}
        for task in (task.name for task in bench.tasks):
            study = bench.study(task)
            bench.train(study, [], METHODS)
            test, scales = study.data.test, study.scales
            numbers[task] = {
                name: [
                    errors(study.prediction(seed, name), test, scales).mse
                    for seed in study.config.seeds
                ]
                for name in METHODS
            }
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """A row a task; what RSSM gains of what there is to gain."""
        rows, lines = [], []
        for task, mse in numbers.items():
            direct, known = mean(mse["DirectPred"]), paper.SINGLE_STEP[task]
            rows.append([
                task,
                *(spread(mse[name]) for name in METHODS),
                *(short(mean(mse[name]) / direct) for name in METHODS[1:]),
                short(known["RSSM"] / known["DirectPred"]),
            ])  # fmt: skip
            lines.append(
                f"{task}: told what is hidden, DirectPred makes "
                f"{gain(mse['DirectPred'], mse['PrivilegedPred'])} error; RSSM, which infers it, "
                f"{gain(mse['DirectPred'], mse['RSSM'])}."
            )
        head = ["task", *METHODS, *(f"{name} / DirectPred" for name in METHODS[1:]),
                "paper's RSSM / DirectPred"]  # fmt: skip
        return Section(
            "PrivilegedPred is DirectPred that is told the hidden variables of the step: what a "
            "history could gain at most by telling them.",
            [Grid(head, rows)],
            {},
            lines,
        )
