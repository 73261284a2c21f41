"""Beyond the paper: ways in which the simulator follows a translation."""

from __future__ import annotations

from typing import get_args

from wt.config import Alignment
from wt.evaluate.multi_step import of_model, roll_out, simulator
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.reproduce.bench import FULL, PLUS, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.exhibits.figure_4 import TASK, draw, gains, horizon_tables, keep, truth_of

ALIGNMENTS: tuple[Alignment, ...] = get_args(Alignment)
METHODS = ((PAPERS_OWN, FULL), (OURS, PLUS))


@register
class Alignments(Exhibit):
    """Rollouts with each alignment, from the same starts and with the same models."""

    name = "alignment"
    order = 110
    title = "Beyond the paper: standing feet that stay, and corrected actions"
    tasks = (TASK,)

    def measure(self, bench: Bench) -> Numbers:
        """Roll out the paper's method and ours in every way; nothing is trained for it."""
        study = bench.study(TASK)
        bench.train(study, [PLUS, FULL])
        numbers: Numbers = {}
        total = 1 + len(METHODS) * len(ALIGNMENTS)
        for seed in study.config.seeds:
            world, truth = truth_of(study, bench.quick, seed)
            scale = study.scales.state
            rolled = {"RawSim": roll_out(world, truth, simulator, scale)}
            for name, variant in METHODS:
                step = of_model(bench.model(study, variant, seed))
                for alignment in ALIGNMENTS:
                    label = f"{name}, {alignment}"
                    bench.listener.progress(f"rollouts, seed {seed}", len(rolled), total)
                    rolled[label] = roll_out(world, truth, step, scale, alignment)
            for label, one in rolled.items():
                keep(numbers, label, one, study)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """Curves, tables and the gain at the longest horizon."""
        return Section(
            'The same models and starts as in the rollouts above. "state": the simulator\'s '
            'observable state is overwritten with the translation. "stance": the same, and height '
            "and velocity of the trunk, which no sensor tells, move by as much as the feet that "
            'stand in the simulator\'s answer otherwise would. "action": the simulator '
            "takes the action under which it comes nearest to the translation by itself (one "
            "damped Gauss-Newton step), and stays consistent with what it keeps inside.",
            [Grid(*table) for table in horizon_tables(numbers)],
            {"alignment": draw(numbers)},
            [
                f"{name}, error with {what}: "
                f"{gains(numbers, f'{name}, state', f'{name}, {alignment}')}."
                for name, _ in METHODS
                for alignment, what in (
                    ("stance", "standing feet that stay"),
                    ("action", "corrected actions"),
                )
            ],
        )
