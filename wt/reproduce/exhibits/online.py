"""Beyond the paper: adaptation during use, when the robot is no longer the one of the training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from wt.config import vary
from wt.evaluate.figures import curves
from wt.evaluate.results import PAPERS_OWN
from wt.reproduce.bench import FULL, MEAN_FIELD, Bench, Variant
from wt.reproduce.exhibit import Exhibit, Grid, Numbers, Section, register
from wt.reproduce.words import gain, mean, spread
from wt.run.study import Study
from wt.train.online import OnlineAdaptation
from wt.train.score import PairTensors, errors
from wt.types import Pairs, Transitions
from wt.worlds.base import make

WORN = (
    "world.real.stiffness=[50,50,50,25,6,6]",
    "world.real.damping=[0.8,0.8,0.8,0.8,0.8,0.8]",
    "world.real.mass_scale=[1.6,1.6,1.6,1.6,1.6,1.6]",
)
"""R some time later: weaker drives, stiffer grease, a heavier load."""
ADAPTING = ("online.iterations=200",)
PARTS, PART, PART_QUICK = 10, 1000, 300
"""The stream, in parts of so many transitions: 20 s of the robot each."""
PAIRS, PAIRS_QUICK = 5000, 500
STREAM_SEED, PAIRS_SEED = 2000, 3000
METHODS = ((PAPERS_OWN, FULL), (MEAN_FIELD.name, MEAN_FIELD))


@register
class OnlineExhibit(Exhibit):
    """Error on the changed robot along a stream of its transitions, with adaptation or without."""

    name = "online"
    order = 100
    title = "Beyond the paper: online adaptation on a stream"
    tasks = ("r5_force",)

    def measure(self, bench: Bench) -> Numbers:
        """Adapt trained models to a stream of the changed robot, seed by seed."""
        study = bench.study("r5_force")
        bench.train(study, [MEAN_FIELD, FULL])
        worn = make(bench.config("r5_force", WORN).world)
        part = PART_QUICK if bench.quick else PART
        iterations = vary(study.config.paper, ADAPTING).online.iterations
        numbers: Numbers = {
            "part": part,
            "iterations": iterations,
            "rate_hz": study.world.spec.rate_hz,
            "mse": {},
        }
        for seed in study.config.seeds:
            stream = worn.collect("real", PARTS * part, STREAM_SEED + seed)
            count = PAIRS_QUICK if bench.quick else PAIRS
            pairs = worn.pairs("test", count, PAIRS_SEED + seed)
            raw = float(np.mean(((pairs.sim_next - pairs.real.s_next) / study.scales.state) ** 2))
            numbers["mse"].setdefault("RawSim", []).append([raw] * (PARTS + 1))
            for i, (name, variant) in enumerate(METHODS):
                bench.listener.progress(f"streams, seed {seed}", i, len(METHODS))
                along = _adapt(bench, study, variant, seed, stream, pairs)
                numbers["mse"].setdefault(name, []).append([along[0]] * len(along))
                numbers["mse"].setdefault(f"{name}, adapting", []).append(along)
        return numbers

    def present(self, numbers: Numbers) -> Section:
        """Error over the length of the stream."""
        part, rate = numbers["part"], numbers["rate_hz"]
        seconds = np.arange(PARTS + 1) * part / rate
        lines = {name: (seconds, np.mean(runs, axis=0)) for name, runs in numbers["mse"].items()}
        head = ["MSE on the changed robot", "before", "halfway", "at the end"]
        rows = [
            [name, *(spread([run[k] for run in runs]) for k in (0, PARTS // 2, PARTS))]
            for name, runs in numbers["mse"].items()
        ]
        ends = {name: [run[-1] for run in runs] for name, runs in numbers["mse"].items()}
        return Section(
            "The R5 of domain R has changed after training: weaker drives, more friction, a "
            f"heavier load. Its transitions come in parts of {part / rate:g} s under the hidden "
            "forces, unpaired; after each part Algorithm 1 goes on for "
            f"{numbers['iterations']} iterations, with the old transitions of S. "
            "The error is on pairs of the changed robot.",
            [Grid(head, rows)],
            {"online": curves([("MSE on the changed robot", lines)], "seconds of stream")},
            [_gain(name, ends, seconds[-1]) for name, _ in METHODS],
        )


def _gain(name: str, ends: Mapping[str, Sequence[float]], seconds: float) -> str:
    adapted = ends[f"{name}, adapting"]
    return (
        f"{name}: after {seconds:g} s, {gain(ends[name], adapted)} error than without adaptation, "
        f"{mean(adapted) / mean(ends['RawSim']):.3g} of RawSim's."
    )


def _adapt(
    bench: Bench, study: Study, variant: Variant, seed: int, stream: Transitions, pairs: Pairs
) -> list[float]:
    """Errors on pairs before the stream and after each of its parts."""
    model = bench.model(study, variant, seed)
    model.method = (
        variant._replace(changes=(*variant.changes, *ADAPTING)).job(seed).settings(study.config)
    )
    adaptation = OnlineAdaptation(model, study.data.sim, seed)
    scales = (torch.tensor(x) for x in (study.scales.state, study.scales.change))
    tensors = PairTensors.of(pairs, *scales)
    along = [errors(adaptation.model, tensors)[0]]
    for rows in np.array_split(np.arange(len(stream)), PARTS):
        adaptation.learn(stream.select(rows))
        along.append(errors(adaptation.model, tensors)[0])
    return along
