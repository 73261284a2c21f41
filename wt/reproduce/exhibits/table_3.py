"""Table III: the worth of cycle consistency and of the identity loss."""

from __future__ import annotations

from wt.evaluate import paper
from wt.reproduce.bench import FULL, Bench, Variant
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import UNITS, gain, in_units, keep_errors, mean, order, spread

NO_CYCLE = Variant("w/o cycle", changes=("translation.cycle=0",))
NO_IDENTITY = Variant("w/o identity", changes=("translation.identity=0",))
NEITHER = Variant("w/o both", changes=(*NO_CYCLE.changes, *NO_IDENTITY.changes))
"""As an experiment on what each is worth where the other does not do its work as well."""
HEAVY = ("translation.cycle=10", "translation.identity=5")
"""The weights of CycleGAN on images, as an experiment on why the table may come out otherwise."""
AT_HEAVY = (
    Variant("full", changes=HEAVY),
    Variant("w/o cycle", changes=("translation.cycle=0", HEAVY[1])),
    Variant("w/o identity", changes=(HEAVY[0], "translation.identity=0")),
)
COLUMNS = ("cycle", "identity", "prediction")


@register
class TranslationLosses(Exhibit):
    """Cycle, identity and prediction error of three variants, at two sets of weights."""

    name = "table-3"
    order = 60
    title = "Ablation of the translation's losses (table III)"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Train each variant and look at its errors."""
        study = bench.study("r5_force")
        sets = {"ours": (FULL, NO_CYCLE, NO_IDENTITY, NEITHER), "heavy": AT_HEAVY}
        bench.train(study, [variant for variants in sets.values() for variant in variants])
        numbers: Numbers = {}
        for weights, variants in sets.items():
            for variant in variants:
                values: dict[str, list[float]] = {column: [] for column in COLUMNS[:2]}
                for seed in study.config.seeds:
                    sim, real = bench.features(study, variant, seed)
                    values["cycle"].append(0.5 * (sim.cycle_error + real.cycle_error))
                    values["identity"].append(real.identity_error)
                    keep_errors(values, bench.errors(study, variant, seed))
                values["prediction"] = values["mse"]
                numbers.setdefault(weights, {})[variant.name] = values
        settings = study.config.paper.translation
        numbers["weights"] = [settings.cycle, settings.identity]
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """Both sets of weights beside the paper's table."""
        cycle, identity = numbers["weights"]
        ours = f"Weights of the configuration: cycle {cycle:g}, identity {identity:g}."
        return Section(
            "Cycle error ‖z − G(G(z))‖ of both domains, identity error ‖zR − G(zR)‖ of the "
            "generator into R, both L1 per channel, and the single-step error on the test pairs.",
            [
                Grid(_HEAD, _rows(numbers["ours"]), ours),
                Grid(_HEAD, _rows(numbers["heavy"]), "CycleGAN's weights: cycle 10, identity 5."),
                *(
                    Grid(
                        ["prediction error", *UNITS.values()],
                        [[name, *in_units(values)] for name, values in numbers[weights].items()],
                        f"In all units, at {said} weights.",
                    )
                    for weights, said in (("ours", "our"), ("heavy", "CycleGAN's"))
                ),
            ],
            differences=_differences(numbers),
        )


_HEAD = ["variant", *COLUMNS, "/ full", *(f"paper's {c}" for c in COLUMNS), "/ full"]


def _rows(table: Numbers) -> list[list[str]]:
    rows = []
    for name, values in table.items():
        ratio = mean(values["prediction"]) / mean(table["full"]["prediction"])
        papers = ["–"] * (len(COLUMNS) + 1)
        if theirs := paper.ABLATION.get(name):
            papers = [*map(str, theirs), f"{theirs[2] / paper.ABLATION['full'][2]:.2f}"]
        cells = [spread(values[column]) for column in COLUMNS]
        rows.append([name, *cells, f"{ratio:.2f}", *papers])
    return rows


def _differences(numbers: Numbers) -> list[str]:
    lines = []
    for i, column in enumerate(COLUMNS):
        papers = {name: row[i] for name, row in paper.ABLATION.items()}
        for weights, said in (("ours", "at our weights"), ("heavy", "at CycleGAN's")):
            ours = {name: mean(numbers[weights][name][column]) for name in papers}
            lines.append(order(ours, papers, f"{column.capitalize()} error {said}"))
    errors = {name: values["prediction"] for name, values in numbers["ours"].items()}
    worth = {name: gain(errors[name], errors["full"]) for name in errors}
    lines.append(
        f"With both losses the error is {worth[NO_CYCLE.name]} than without cycle, "
        f"{worth[NO_IDENTITY.name]} than without identity, {worth[NEITHER.name]} than without "
        f"either; identity alone makes it {gain(errors[NEITHER.name], errors[NO_CYCLE.name])} than "
        f"neither, cycle alone {gain(errors[NEITHER.name], errors[NO_IDENTITY.name])}."
    )
    return lines
