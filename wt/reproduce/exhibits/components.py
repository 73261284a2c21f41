"""Worth of each auxiliary part of feature extraction: blind decoder, classifier, FiLM."""

from __future__ import annotations

from wt.evaluate.probes import domain_table
from wt.reproduce.bench import BASIC, FULL, Bench, Variant
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import UNITS, gain, in_units, keep_errors, spread

VARIANTS = (
    FULL,
    Variant("w/o blind decoder", changes=("vae.blind_weight=0",)),
    Variant("w/o classifier", changes=("vae.classifier_weight=0",)),
    Variant("w/o FiLM", changes=("nets.film=false",)),
    Variant("w/o classifier and FiLM", changes=BASIC.changes),
)
ROWS = {"own": "zS", "translated": "zS→R", "combined": "(o, a)S, zS→R"}


@register
class Components(Exhibit):
    """Prediction error and domain accuracy with each part left out."""

    name = "components"
    order = 70
    title = "Ablation of the auxiliary parts"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Train each variant; probe the domain in its features."""
        study = bench.study("r5_force")
        bench.train(study, VARIANTS)
        numbers: Numbers = {}
        for variant in VARIANTS:
            values: dict[str, list[float]] = {}
            for seed in study.config.seeds:
                table = domain_table(*bench.features(study, variant, seed), seed)
                for key, name in ROWS.items():
                    values.setdefault(key, []).append(table[name])
                keep_errors(values, bench.errors(study, variant, seed))
            numbers[variant.name] = values
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """One row a variant."""
        probed = (f"{name} as {name[-1]}" for name in ROWS.values())
        head = ["variant", *UNITS.values(), *probed]
        rows = [
            [name, *in_units(values), *(spread(values[key]) for key in ROWS)]
            for name, values in numbers.items()
        ]
        full = numbers["full"]["mse"]
        return Section(
            "Single-step error of the paper's method, and how often a probe takes features for "
            "the domain they are meant to be of. The paper has no table of these.",
            [Grid(head, rows)],
            differences=[
                f"{name[:1].upper()}{name[1:]}: error {gain(full, values['mse'])} than in full."
                for name, values in numbers.items()
                if name != "full"
            ],
        )
