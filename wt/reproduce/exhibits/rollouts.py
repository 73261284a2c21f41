"""Beyond figure 4: the same rollouts on the other robots that walk."""

from __future__ import annotations

from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.exhibits.figure_4 import (
    ABOUT,
    TASK,
    draw,
    horizon_tables,
    roll_out_all,
    shares,
)
from wt.reproduce.tasks import WALKING


@register
class Rollouts(Exhibit):
    """Divergence and error over horizons up to 50, of every other walking task."""

    name = "rollouts"
    order = 23
    title = "Beyond figure 4: multi-step rollouts of the other robots that walk"
    tasks = tuple(name for name in WALKING if name != TASK)
    any_task = True

    def measure(self, bench: Bench) -> Numbers:
        """Roll out every method with every seed of each task."""
        there = [task.name for task in bench.tasks if task.name in self.tasks]
        return {name: roll_out_all(bench, name) for name in there}

    def present(self, numbers: Numbers) -> Section:
        """Curves and tables of each task."""
        grids = []
        for task, of_task in numbers.items():
            tables = horizon_tables(of_task["rolled"])
            grids += [Grid([f"{task}: {head[0]}", *head[1:]], rows) for head, rows in tables]
            grids += shares(of_task)
        figures = {f"rollouts_{task}": draw(of["rolled"]) for task, of in numbers.items()}
        return Section(ABOUT, grids, figures)
