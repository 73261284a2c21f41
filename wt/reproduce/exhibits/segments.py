"""Beyond the paper: training on segments of trajectories instead of single steps."""

from __future__ import annotations

from wt.evaluate.multi_step import alignment_of, of_model, roll_out, simulator
from wt.reproduce.bench import FULL, Bench, Variant
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.exhibits.figure_4 import TASK, draw, gains, horizon_tables, keep, truth_of
from wt.reproduce.words import gain

VARIANTS = (
    Variant("single steps", FULL.method, FULL.changes),
    Variant("segments of 4", changes=("train.segment=4",)),
    Variant("segments of 10", changes=("train.segment=10",)),
)


@register
class SegmentTraining(Exhibit):
    """Single-step error and rollouts of the paper's method, trained on segments or not."""

    name = "segments"
    order = 90
    title = "Beyond the paper: multi-step training on segments"
    tasks = (TASK,)

    def measure(self, bench: Bench) -> Numbers:
        """Train each variant on the same data and seeds, and roll it out from the same starts."""
        study = bench.study(TASK)
        bench.train(study, VARIANTS)
        numbers: Numbers = {"single": {}, "rolled": {}}
        # where nothing is translated, as by RawSim, it does not matter
        alignment = alignment_of(study.config, FULL.method)
        for seed in study.config.seeds:
            world, truth = truth_of(study, bench.quick, seed)
            steps = {v.name: of_model(bench.model(study, v, seed)) for v in VARIANTS}
            for label, step in {"RawSim": simulator, **steps}.items():
                rolled = roll_out(world, truth, step, study.scales.state, alignment)
                keep(numbers["rolled"], label, rolled, study)
            for variant in VARIANTS:
                mse = bench.errors(study, variant, seed).mse
                numbers["single"].setdefault(variant.name, []).append(mse)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """Curves, tables and the gain."""
        plain, *others = numbers["single"]
        lines = []
        for name in others:
            single = gain(numbers["single"][plain], numbers["single"][name])
            lines.append(
                f"{name[:1].upper()}{name[1:]} against single steps: single-step error {single}, "
                f"{gains(numbers['rolled'], plain, name)}."
            )
        return Section(
            "The paper's method on Go2 with payload. With segments, the decoder is also trained to "
            "go on from its own predictions, with features of the observed transitions.",
            [Grid(*table) for table in horizon_tables(numbers["rolled"])],
            {"segments": draw(numbers["rolled"])},
            lines,
        )
