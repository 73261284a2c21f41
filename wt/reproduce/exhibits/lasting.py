"""Figure 3, an experiment: forces that last, so that the past tells what acts."""

from __future__ import annotations

from wt.evaluate import paper
from wt.evaluate.results import PAPERS_OWN
from wt.evaluate.single_step import errors
from wt.reproduce.bench import FULL, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import UNITS, in_units, keep_errors, mean, order
from wt.show.text import short

LASTING = ("world.force.appear=0.006", "world.force.vanish=0.01", "world.force.turn=0.01")
"""As often as in conf/r5.yaml, but for 2 s on average, not 80 ms, and turning a tenth as often."""
BASELINES = ("RawSim", "DirectPred", "RSSM", "ResDyn")
TASK = "r5_force"


@register
class LastingForces(Exhibit):
    """The methods of figure 3 where a force can be told from what it did before."""

    name = "lasting"
    order = 15
    title = "Figure 3, an experiment: forces that last"
    tasks = (TASK,)

    def measure(self, bench: Bench) -> Numbers:
        """Train the paper's method and its baselines in that world, with every seed."""
        study = bench.study(TASK, LASTING, "lasting")
        bench.train(study, [FULL], BASELINES)
        test, scales = study.data.test, study.scales
        numbers: dict[str, dict[str, list[float]]] = {}
        for seed in study.config.seeds:
            for name in BASELINES:
                found = errors(study.prediction(seed, name), test, scales)
                keep_errors(numbers.setdefault(name, {}), found)
            theirs = bench.errors(study, FULL, seed)
            keep_errors(numbers.setdefault(PAPERS_OWN, {}), theirs)
        return {"single": numbers}

    def present(self, numbers: Numbers) -> Section:
        """Errors in units of RawSim's, the paper's beside them."""
        single: dict[str, dict[str, list[float]]] = numbers["single"]
        known = paper.SINGLE_STEP[TASK]
        raw = mean(single["RawSim"]["mse"])
        relative = {name: mean(found["mse"]) / raw for name, found in single.items()}
        papers = {name: value / known["RawSim"] for name, value in known.items()}
        rows = [
            [name, *in_units(found), short(relative[name]), short(papers[name])]
            for name, found in single.items()
        ]
        return Section(
            "The configured forces come and go within a few control steps, so that nothing before "
            "a transition tells what acts in it; RawSim is told. Here they last 2 s on average.",
            [Grid(["method", *UNITS.values(), "/ RawSim", "paper's"], rows)],
            {},
            [order(relative, papers, "Forces that last")],
        )
