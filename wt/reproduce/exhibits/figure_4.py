"""Figure 4: multi-step rollouts, the policy acting on predicted states.

The paper's are of the Go2 with payload; the other robots that walk have the same tables.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wt.evaluate import paper
from wt.evaluate.figures import curves
from wt.evaluate.multi_step import (
    Rolled,
    Step,
    alignment_of,
    of_baseline,
    of_model,
    roll_out,
    score,
    simulator,
    still,
)
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.evaluate.single_step import by_kind
from wt.nets.world_model import WorldModel
from wt.reproduce.bench import FULL, PLUS, Bench
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.tasks import WALKING
from wt.reproduce.words import gain, mean, spread
from wt.run.study import Study
from wt.worlds.closed_loop import ClosedLoop, ReferenceRollouts

Table = tuple[list[str], list[list[str]]]
"""Head and rows."""

TASK = "go2_payload"
"""The paper's, and of the exhibits that go on from it."""
HORIZON = 50
ROLLOUTS, ROLLOUTS_QUICK = 512, 64
SHOWN = (1, 5, 10, 20, 30, 40, 50)
BASELINES = ("DirectPred", "ResDyn", "ResDynSim", "RSSM")
MEAN = "R's mean state"
"""What no rollout is better than has lost all that its start told."""
GAINS_AT = (10, 50)
"""Horizons at which extensions are compared with the plain method."""
START_SEED = 1000
"""Of the starts of rollouts; the same for every method."""


def truth_of(study: Study, quick: bool, seed: int) -> tuple[ClosedLoop, ReferenceRollouts]:
    """A task's closed loop, and what R does in it from one set of starts."""
    world = study.world
    if not isinstance(world, ClosedLoop):
        raise TypeError(f"{study.config.task} has no closed loop")
    count = ROLLOUTS_QUICK if quick else ROLLOUTS
    past = study.config.baselines.history
    return world, world.truth(count, past, HORIZON, START_SEED + seed)


def keep(numbers: Numbers, label: str, rolled: Rolled, study: Study) -> None:
    """Add one seed's rollouts; NaN, where every rollout has diverged, is kept as null."""
    of_change = ((rolled.rmse / study.scales.change) ** 2).mean(axis=1)
    physical = by_kind(rolled.rmse, study.world.spec.state)
    columns = {
        "mse": rolled.mse,
        "mse_change": of_change,
        "diverged": rolled.diverged,
        "amplitude": rolled.amplitude,
        "correlation": rolled.correlation,
        **{f"{kind.name} [{kind.unit}]": rmse for kind, rmse in physical.items()},
    }
    values = numbers.setdefault(label, {})
    for name, column in columns.items():
        row = [float(x) if np.isfinite(x) else None for x in column]
        values.setdefault(name, []).append(row)


@register
class MultiStep(Exhibit):
    """Divergence and error over horizons up to 50 for every method."""

    name = "figure-4"
    order = 20
    title = "Multi-step rollouts (figure 4: on Go2 with payload)"
    tasks = WALKING
    any_task = True

    def measure(self, bench: Bench) -> Numbers:
        """Roll out every method with every seed of each task from the same starts."""
        there = [task.name for task in bench.tasks if task.name in self.tasks]
        return {name: roll_out_all(bench, name) for name in there}

    def present(self, numbers: Numbers) -> Section:
        """Curves, tables at some horizons, and how ours says what is hidden goes on."""
        figures: dict[str, Figure] = {}
        grids, lines = [], []
        for task, found in numbers.items():
            rolled = found["rolled"]
            for head, rows in [*horizon_tables(rolled, task == TASK), *shares(found)]:
                grids.append(Grid([f"{task}: {head[0]}", *head[1:]], rows))
            figures |= {
                f"multi_step_{task}": draw(rolled),
                f"multi_step_units_{task}": draw_units(rolled),
            }
            lines += [f"{task}: {line}" for line in _differences(rolled, task == TASK)]
        return Section(
            "Each method runs on its own predictions for 50 control steps (1 s) from states of R: "
            "the policy acts on the prediction, the simulator answers from it, and its observable "
            "state is overwritten with what the method makes of the answer (where S encodes what "
            "is hidden, ours also says how that goes on, as R's recording tells: of how R's "
            "differs from S's after a step, the share in the last table is applied, with which "
            "held-out recordings of R are followed best). A rollout has "
            "diverged once the trunk's height, tilt, velocity or turning rate is out of bounds; "
            "the error is the mean over those that have not. RawSim starts from R's true hidden "
            "state, as all do. A method that is not better than R's mean state, always the same "
            "one, knows no more of where its rollout began.",
            grids,
            figures,
            lines,
        )


def roll_out_all(bench: Bench, task: str) -> Numbers:
    """Every method with every seed of a task, from the same starts: errors, and ours' shares."""
    study = bench.study(task)
    baselines = [name for name in BASELINES if name in study.config.baselines.names]
    bench.train(study, [PLUS, FULL], baselines)
    rolled: Numbers = {}
    shares_of: Numbers = {}
    for seed in study.config.seeds:
        world, truth = truth_of(study, bench.quick, seed)
        plus = bench.model(study, PLUS, seed)
        steps: dict[str, Step] = {
            "RawSim": simulator,
            **{b: of_baseline(bench.baseline(study, b, seed), world) for b in baselines},
            PAPERS_OWN: of_model(bench.model(study, FULL, seed)),
            OURS: of_model(plus),
        }
        for i, (method, step) in enumerate(steps.items()):
            bench.listener.progress(f"rollouts, seed {seed}", i, len(steps))
            alignment = alignment_of(study.config, method)
            keep(rolled, method, roll_out(world, truth, step, study.scales.state, alignment), study)
        mean = still(truth, study.data.real.s_next.mean(axis=0))
        keep(rolled, MEAN, score(mean, truth, study.scales.state), study)
        for name, share in of_hidden(plus).items():
            shares_of.setdefault(name, []).append(share)
    return {"rolled": rolled, "shares": shares_of}


def of_hidden(model: WorldModel) -> dict[str, float]:
    """Of what a model knows to be hidden: share of R's difference from S that is applied."""
    shift = model.frame.hidden
    if shift is None:
        return {}
    known = (shift.unit > 0).tolist()
    found = zip(model.spec.hidden, shift.gain.tolist(), known, strict=True)
    return {channel.name: gain for channel, gain, told in found if told}


def shares(numbers: Numbers) -> list[Table]:
    """A table of :func:`of_hidden`, mean and spread over seeds; none where nothing goes on."""
    rows = [[name, spread(values)] for name, values in numbers["shares"].items()]
    return [(["what is hidden", "share applied"], rows)] if rows else []


def draw(numbers: Numbers) -> Figure:
    """Divergence and error over the horizon, mean over seeds."""
    horizon = np.arange(1, HORIZON + 1)
    rates = {m: (horizon, 100 * over(v["diverged"])) for m, v in numbers.items()}
    errors = {m: (horizon, over(v["mse"])) for m, v in numbers.items()}
    return curves([("diverged rollouts [%]", rates), ("MSE of the normalised state", errors)],
                  "horizon [control steps]", zoom=True)  # fmt: skip


def draw_units(numbers: Numbers) -> Figure:
    """Error over the horizon in the other units: of the change, and physical."""
    horizon = np.arange(1, HORIZON + 1)
    panels = [
        (f"RMSE of {name}" if name in _kinds(numbers) else "MSE of the normalised change",
         {m: (horizon, over(v[name])) for m, v in numbers.items()})
        for name in ("mse_change", *_kinds(numbers))
    ]  # fmt: skip
    return curves(panels, "horizon [control steps]", zoom=True)


def gains(numbers: Numbers, plain: str, other: str) -> str:
    """Gain of one method over another at some horizons, from the same starts."""
    said = []
    for horizon in GAINS_AT:
        ends = [
            [row[horizon - 1] for row in numbers[name]["mse"] if row[horizon - 1] is not None]
            for name in (plain, other)
        ]
        comparable = len(ends[0]) == len(ends[1]) > 0
        said.append(f"{gain(*ends) if comparable else 'diverged'} at horizon {horizon}")
    return ", ".join(said)


def over(by_seed: list[list[float | None]]) -> np.ndarray:
    """Mean over seeds at each horizon; NaN where a seed has nothing left to measure."""
    return np.mean([[np.nan if x is None else x for x in row] for row in by_seed], axis=0)


def horizon_tables(numbers: Numbers, papers: bool = True) -> list[Table]:
    """Error in each unit, and divergence, at some horizons: head and rows of each table.

    Args:
        numbers: of :func:`keep`.
        papers: whether the paper's divergence is of the same task.
    """
    return [
        horizon_table(numbers, "mse", "MSE at horizon"),
        _divergence(numbers, papers),
        horizon_table(numbers, "mse_change", "MSE of the change at horizon"),
        *(horizon_table(numbers, kind, f"RMSE of {kind} at horizon") for kind in _kinds(numbers)),
    ]


def horizon_table(numbers: Numbers, column: str, title: str) -> Table:
    """One of what :func:`keep` keeps at some horizons: head and rows."""
    rows = [
        [m, *(spread([row[h - 1] for row in v[column] if row[h - 1] is not None]) for h in SHOWN)]
        for m, v in numbers.items()
    ]
    return [title, *map(str, SHOWN)], rows


def _kinds(numbers: Numbers) -> list[str]:
    """Kinds of channels with their units."""
    return [name for name in next(iter(numbers.values())) if name.endswith("]")]


def _divergence(numbers: Numbers, papers: bool) -> Table:
    rows = []
    for method, values in numbers.items():
        cells = [spread([100 * row[h - 1] for row in values["diverged"]]) for h in SHOWN]
        theirs = paper.DIVERGED_AT_50.get(method)
        rows.append([method, *cells, "–" if theirs is None else f"{100 * theirs:g}"])
    head = ["% diverged at horizon", *map(str, SHOWN), "paper's at 50"]
    if papers and PAPERS_OWN in numbers:
        return head, rows
    # among variants, and elsewhere, there is nothing of the paper's to compare with
    return head[:-1], [row[:-1] for row in rows]


def _differences(numbers: Numbers, papers: bool) -> list[str]:
    raw, lines = over(numbers["RawSim"]["mse"]), []
    for method in (PAPERS_OWN, OURS):
        mse, rate = over(numbers[method]["mse"]), over(numbers[method]["diverged"])
        below = mse < raw
        until = HORIZON if below.all() else int(np.argmin(below))
        said = (
            f"; the paper's has the lowest error up to about {paper.LOWEST_UNTIL} and diverges in "
            f"{100 * paper.DIVERGED_AT_50[PAPERS_OWN]:g} %"
        )
        lines.append(
            f"{method} is below RawSim's error at every horizon up to {until} (of {HORIZON}), "
            f"{100 * rate[-1]:.1f} % diverged at {HORIZON}{said if papers else ''}."
        )
    at = {m: mean([row[-1] for row in v["diverged"]]) for m, v in numbers.items()}
    worst = max(at, key=lambda m: at[m])
    most = f"{worst} diverges most, {100 * at[worst]:.1f} %" if at[worst] else "none diverges"
    said = f"; in the paper DirectPred does, about {100 * paper.DIVERGED_AT_50['DirectPred']:g} %"
    lines.append(f"{most} at {HORIZON}{said if papers else ''}.")
    return lines
