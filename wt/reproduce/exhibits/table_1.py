"""Table I: the hidden force, read off representations."""

from __future__ import annotations

from wt.evaluate import paper
from wt.evaluate.probes import hidden_baseline, hidden_table
from wt.reproduce.bench import BASIC, FULL, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import mean, spread


@register
class HiddenProbes(Exhibit):
    """R² of the force's magnitude from (o, a), (o, a, o′) and (o, a, z)."""

    name = "table-1"
    order = 30
    title = "The hidden variable in representations (table I)"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """One probe a representation and seed, for the full and the basic model."""
        study = bench.study("r5_force")
        bench.train(study, [FULL, BASIC])
        numbers: Numbers = {"baseline": {}, "full": {}, "w/o": {}}
        for seed in study.config.seeds:
            for variant in (FULL, BASIC):
                sim, real = bench.features(study, variant, seed)
                tables = {variant.name: hidden_table(sim, real, seed)}
                if variant is FULL:
                    tables["baseline"] = hidden_baseline(sim, real, seed)
                for column, table in tables.items():
                    for row, value in table.items():
                        numbers[column].setdefault(row, []).append(value)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """The paper's rows, and what the auxiliary parts cost."""
        rows = [
            [row, spread(numbers["baseline"][row]), "", str(theirs), ""]
            for row, theirs in paper.HIDDEN_R2_BASELINE.items()
        ]
        for row in paper.HIDDEN_R2["full"]:
            ours = [spread(numbers[column][row]) for column in ("w/o", "full")]
            theirs = [str(paper.HIDDEN_R2[column][row]) for column in ("w/o", "full")]
            rows.append([row, *ours, *theirs])
        return Section(
            "R² with which a small network tells the magnitude of the external force from a "
            "representation; it learns on one half of the episodes and is tested on the other. "
            '"w/o" is the basic VAE without domain classifier and FiLM.',
            [Grid(["input", "w/o", "full", "paper w/o", "paper full"], rows)],
            differences=_differences(numbers),
        )


def _differences(numbers: Numbers) -> list[str]:
    full, basic, seen = numbers["full"], numbers["w/o"], numbers["baseline"]
    kept = {d: mean(full[f"(o, a){d}, z{way}"]) / mean(full[f"(o, a){d}, z{d}"])
            for d, way in (("S", "S→R"), ("R", "R→S"))}  # fmt: skip
    cost = mean([mean(full[row]) - mean(basic[row]) for row in full])
    leak = [mean(seen[f"(o, a){d}"]) for d in "SR"]
    transition = [mean(seen[f"(o, a, o′){d}"]) for d in "SR"]
    papers = paper.HIDDEN_R2_BASELINE
    return [
        f"(o, a) alone gives away {leak[0]:.2f} and {leak[1]:.2f} of the force, the whole "
        f"transition {transition[0]:.2f} and {transition[1]:.2f} (in the paper "
        f"{papers['(o, a)S']} and "
        f"{papers['(o, a)R']}, {papers['(o, a, o′)S']} and {papers['(o, a, o′)R']}): how much "
        "(o, a) leaks depends on how long a force lasts and how the collecting policy reacts; here "
        "forces come and go within a few control steps.",
        f"Translation keeps {100 * kept['S']:.0f} % of R² from S to R and {100 * kept['R']:.0f} % "
        "from R to S.",
        f"The auxiliary parts change R² by {cost:+.3f} on average: "
        + ("as in the paper, they cost next to nothing." if abs(cost) < 0.05 else
           "more than the paper's 0.01."),
    ]  # fmt: skip
