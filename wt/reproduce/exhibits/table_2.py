"""Table II: the domain, read off representations."""

from __future__ import annotations

from wt.evaluate import paper
from wt.evaluate.probes import domain_table
from wt.reproduce.bench import BASIC, FULL, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import mean, spread

COMBINED = "(o, a)S, zS→R"


@register
class DomainProbes(Exhibit):
    """Accuracy of the domain from (o, a), z, and both."""

    name = "table-2"
    order = 40
    title = "The domain in representations (table II)"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Three probes a seed, for the full and the basic model."""
        study = bench.study("r5_force")
        bench.train(study, [FULL, BASIC])
        numbers: Numbers = {"full": {}, "w/o": {}}
        for seed in study.config.seeds:
            for variant in (FULL, BASIC):
                sim, real = bench.features(study, variant, seed)
                for row, value in domain_table(sim, real, seed).items():
                    numbers[variant.name].setdefault(row, []).append(value)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """The paper's rows with the domain that each is meant to be of."""
        rows = []
        for row in numbers["full"]:
            alone = row in paper.DOMAIN_BASELINE
            ours = [spread(numbers[column][row]) for column in ("w/o", "full")]
            theirs = [
                f"{(paper.DOMAIN_BASELINE if alone else paper.DOMAIN[column])[row]:.3g}"
                for column in ("w/o", "full")
            ]
            rows.append([row, row[-1], *ours, *theirs])
        head = ["input", "target", "w/o", "full", "paper w/o", "paper full"]
        return Section(
            "Share of features that a small network takes for the target domain. It learns S "
            "against R on features that are not translated, on one half of the episodes; "
            "translated ones of the other half are shown beside the (o, a) of the domain they "
            "come from, as in use.",
            [Grid(head, rows)],
            differences=_differences(numbers),
        )


def _differences(numbers: Numbers) -> list[str]:
    leak = [mean(numbers["full"][f"(o, a){d}"]) for d in "SR"]
    papers = paper.DOMAIN_BASELINE
    basic, full = (mean(numbers[column][COMBINED]) for column in ("w/o", "full"))
    own = mean(numbers["full"]["zS"])
    shown = paper.DOMAIN
    return [
        f"(o, a) alone tells the domain in {100 * leak[0]:.0f} % (S) and {100 * leak[1]:.0f} % (R) "
        f"of transitions; in the paper {100 * papers['(o, a)S']:.0f} and "
        f"{100 * papers['(o, a)R']:.0f} %: how much the policy's actions give away.",
        f"z of the full model tells it in {100 * own:.0f} % (paper {100 * shown['full']['zS']:.0f} "
        "%).",
        f"Translated, beside S's own (o, a), it passes for R in {100 * full:.0f} % with the "
        f"auxiliary parts and in {100 * basic:.0f} % without (paper "
        f"{100 * shown['full'][COMBINED]:.0f} and {100 * shown['w/o'][COMBINED]:.0f} %): "
        + ("they are what lets z override (o, a), as the paper says."
           if full > basic + 0.1 else "here they are not what decides it."),
    ]  # fmt: skip
