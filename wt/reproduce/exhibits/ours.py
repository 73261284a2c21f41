"""Beyond the paper: what our translator is made of, one part added or left out at a time."""

from __future__ import annotations

from wt.evaluate.results import OURS
from wt.evaluate.single_step import errors
from wt.reproduce.bench import FULL, MEAN_FIELD, PLUS, Bench, Variant
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import UNITS, gain, in_units, keep_errors, mean
from wt.train.score import PairTensors, predictions

CONDITIONED = Variant(
    "the paper's, conditioned on (o, a), least squares",
    changes=("translation.conditioned=true", "translation.adversarial=lsgan",
             "translation.cycle=0.1", "translation.identity=0"),
)  # fmt: skip
VARIANTS = (
    Variant("the paper's", FULL.method, FULL.changes),
    CONDITIONED,
    MEAN_FIELD,
    Variant("… w/o transport", OURS, (*MEAN_FIELD.changes, "translation.transport=false")),
    Variant("… w/o conditioning", OURS, (*MEAN_FIELD.changes, "translation.conditioned=false")),
    PLUS,
)
NO_TRANSLATION = "… w/o translation"
"""Mean field and transport alone; nothing is trained for it."""


@register
class Ours(Exhibit):
    """Single-step error of the steps from the paper's method to ours."""

    name = "ours"
    order = 85
    title = "Beyond the paper: what our translator is made of"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Train each variant with every seed."""
        study = bench.study("r5_force")
        bench.train(study, VARIANTS)
        numbers: Numbers = {}
        for seed in study.config.seeds:
            for variant in VARIANTS:
                kept = numbers.setdefault(variant.name, {})
                keep_errors(kept, bench.errors(study, variant, seed))
            model, test = bench.model(study, MEAN_FIELD, seed), study.data.test
            model.strength.data.fill_(0.0)
            pairs = PairTensors.of(test, model.frame.state.std, model.frame.change.std)
            alone = errors(predictions(model, pairs).numpy(), test, study.scales)
            keep_errors(numbers.setdefault(NO_TRANSLATION, {}), alone)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """One row a variant, and each against the paper's and ours."""
        mse = {name: values["mse"] for name, values in numbers.items()}
        plain = mse["the paper's"]
        rows = [
            [name, *in_units(values), f"{mean(mse[name]) / mean(plain):.3g}"]
            for name, values in numbers.items()
        ]
        return Section(
            "Single-step error on the R5 under forces. On the way to ours, which has S encode what "
            "is hidden: a mean field that carries what nothing hidden decides, a closed-form "
            "transport, and a translation of what is left that sees (o, a).",
            [Grid(["variant", *UNITS.values(), "/ the paper's"], rows)],
            differences=[
                f"{name[:1].upper()}{name[1:]}: error {gain(plain, values)} than the paper's, "
                f"{gain(mse[OURS], values)} than ours."
                for name, values in mse.items()
                if name not in ("the paper's", OURS)
            ],
        )
