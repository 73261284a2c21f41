"""Figure 4, an experiment: rollouts in which S is told R's hidden state at every step."""

from __future__ import annotations

from wt.evaluate.multi_step import Step, alignment_of, of_baseline, of_model, roll_out, simulator
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.reproduce.bench import FULL, PLUS, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.exhibits.figure_4 import TASK, draw, gains, horizon_tables, keep, truth_of

BASELINES = ("DirectPred", "RSSM")
"""Baselines that read nothing of the simulator: the same as without being told."""
SUFFIX, AS_S = ", told", ", hidden as S's"


@register
class Told(Exhibit):
    """Share of the error of long rollouts that comes from hidden state gone astray."""

    name = "told"
    order = 21
    title = "Figure 4, an experiment: hidden state that does not drift"
    tasks = (TASK,)

    def measure(self, bench: Bench) -> Numbers:
        """Roll out with the hidden state as it goes, and with R's own."""
        study = bench.study(TASK)
        bench.train(study, [PLUS, FULL], BASELINES)
        numbers: Numbers = {}
        for seed in study.config.seeds:
            world, truth = truth_of(study, bench.quick, seed)
            blind = {b: of_baseline(bench.baseline(study, b, seed), world) for b in BASELINES}
            reading: dict[str, Step] = {
                "RawSim": simulator,
                PAPERS_OWN: of_model(bench.model(study, FULL, seed)),
                OURS: of_model(bench.model(study, PLUS, seed)),
            }
            alone = {OURS + AS_S: of_model(bench.model(study, PLUS, seed), carry=False)}
            runs = [(name, step, False) for name, step in (blind | reading | alone).items()]
            runs += [(name, step, True) for name, step in reading.items()]
            for i, (name, step, true_hidden) in enumerate(runs):
                bench.listener.progress(f"rollouts, seed {seed}", i, len(runs))
                alignment = alignment_of(study.config, name.removesuffix(AS_S))
                rolled = roll_out(world, truth, step, study.scales.state, alignment, true_hidden)
                keep(numbers, name + SUFFIX * true_hidden, rolled, study)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """Curves, a table at some horizons, and what being told is worth."""
        return Section(
            "Where the trunk is, how fast it moves and where the ball rolls stays in a rollout as "
            'the simulator left it, and goes astray. "told": R\'s own at every step, which only '
            'an experiment can give. What reads no simulator has no use for it. "hidden as S\'s": '
            "ours without what it says of how R's goes on.",
            [Grid(*table) for table in horizon_tables(numbers)],
            {"told": draw(numbers)},
            [
                *(
                    f"{name}, error where told: {gains(numbers, name, name + SUFFIX)}."
                    for name in ("RawSim", PAPERS_OWN, OURS)
                ),
                f"{OURS}, error with its own say on it: {gains(numbers, OURS + AS_S, OURS)}.",
            ],
        )
