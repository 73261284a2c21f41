"""Figure 4, an experiment: what single-step errors grow to, and the mean of several rollouts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wt.config import Alignment
from wt.evaluate.multi_step import (
    Paths,
    Step,
    alignment_of,
    disturbed,
    follow,
    middle,
    of_baseline,
    of_model,
    score,
    simulator,
)
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.reproduce.bench import FULL, PLUS, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.exhibits.figure_4 import TASK, draw, horizon_table, keep, over, truth_of
from wt.run.study import Study
from wt.types import Domain
from wt.worlds.closed_loop import ClosedLoop, ReferenceRollouts

BASELINES = ("DirectPred", "RSSM")
SEVERAL, SEVERAL_QUICK = 8, 2
"""Rollouts that are averaged."""
OWN, MEAN, REALITY = ", disturbed", ", mean of several", "R itself"


class _Run(NamedTuple):
    """A method, and what it errs by in single steps.

    Attributes:
        step: the method.
        key: of its predictions of the test pairs in the run's folder; None for S's answers.
        alignment: how the simulator follows it.
        domain: whose simulator answers.
    """

    step: Step
    key: str | None
    alignment: Alignment = "state"
    domain: Domain = "sim"

    def disturbed(self, errors: Float[np.ndarray, "pair state"], seed: int) -> _Run:
        """The same, off by errors that are drawn with a seed."""
        return self._replace(step=disturbed(self.step, errors, seed))

    def follow(
        self, world: ClosedLoop, truth: ReferenceRollouts, scale: Float[np.ndarray, " state"]
    ) -> Paths:
        """Its rollouts."""
        return follow(world, truth, self.step, scale, self.alignment, domain=self.domain)


@register
class Sampled(Exhibit):
    """How far errors of single steps carry by themselves, and what a mean of rollouts makes."""

    name = "sampled"
    order = 22
    title = "Figure 4, an experiment: one rollout, or the mean of several"
    tasks = (TASK,)

    def measure(self, bench: Bench) -> Numbers:
        """Roll out as it is, disturbed by own single-step errors, and the mean of several such."""
        study = bench.study(TASK)
        bench.train(study, [PLUS, FULL], BASELINES)
        several = SEVERAL_QUICK if bench.quick else SEVERAL
        rolled: Numbers = {}
        scale = study.scales.state
        for seed in study.config.seeds:
            world, truth = truth_of(study, bench.quick, seed)
            runs = _runs(bench, study, seed)
            for i, (label, run) in enumerate(runs.items()):
                bench.listener.progress(f"rollouts, seed {seed}", i, len(runs))
                errors = _single_step_errors(study, seed, run.key)
                where = world, truth, scale
                paths = [run.disturbed(errors, k).follow(*where) for k in range(several)]
                plain = run.follow(*where)
                found = {label: plain, label + OWN: paths[0], label + MEAN: middle(paths)}
                for name, one in found.items():
                    keep(rolled, name, score(one, truth, scale), study)
        return {"several": several, "rolled": rolled}

    def present(self, numbers: Numbers) -> Section:
        """Errors, liveliness and correlation at some horizons."""
        rolled = numbers["rolled"]
        return Section(
            f"Rollouts as in figure 4. {OWN[2:]}: every predicted state is off by an error that "
            "is drawn, for each robot and step, from the method's own errors on the test pairs. "
            f"{MEAN[2:]}: the mean of {numbers['several']} such rollouts, which is the better "
            "guess once a single one is unsure, whatever the method. R itself, disturbed by ours' "
            "errors: where a method would be that errs by as much in single steps, at random, and "
            "knows all that is hidden. Amplitude is the variance of predictions over rollouts in "
            "units of R's; of predictions that keep to what they are sure of, it is the square of "
            "the correlation.",
            [
                Grid(*horizon_table(rolled, column, f"{title} at horizon"))
                for column, title in (
                    ("mse", "MSE"),
                    ("amplitude", "amplitude"),
                    ("correlation", "correlation"),
                )
            ],
            {"sampled": draw(rolled)},
            _differences(rolled),
        )


def _runs(bench: Bench, study: Study, seed: int) -> dict[str, _Run]:
    """What is rolled out, by its label."""
    world, _ = truth_of(study, True, seed)
    blind = {b: _Run(of_baseline(bench.baseline(study, b, seed), world), b) for b in BASELINES}
    translations = {
        name: _Run(
            of_model(bench.model(study, variant, seed)),
            variant.job(seed).key,
            alignment_of(study.config, name),
        )
        for name, variant in ((PAPERS_OWN, FULL), (OURS, PLUS))
    }
    reality = _Run(simulator, PLUS.job(seed).key, domain="real")
    return {"RawSim": _Run(simulator, None), **blind, **translations, REALITY: reality}


def _single_step_errors(study: Study, seed: int, key: str | None) -> np.ndarray:
    """Errors on the test pairs, (pairs, n_state)."""
    pairs = study.data.test
    predicted = pairs.sim_next if key is None else study.prediction(seed, key)
    return np.asarray(predicted - pairs.real.s_next)


def _differences(numbers: Numbers) -> list[str]:
    mse = {name: over(values["mse"])[-1] for name, values in numbers.items()}
    lines = [
        f"{name}: {mse[name]:.3g} at the end, {mse[name + MEAN]:.3g} as the mean of several."
        for name in ("RawSim", *BASELINES, PAPERS_OWN, OURS)
    ]
    return [
        *lines,
        f"R itself, restarted: {mse[REALITY]:.2g} there; disturbed by ours' errors of single steps "
        f"{mse[REALITY + OWN]:.3g}. The rest of ours' {mse[OURS]:.3g} is what is "
        "hidden, and errors that are not at random.",
    ]
