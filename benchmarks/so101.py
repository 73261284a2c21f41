"""What limits predictions of the real SO-101, motion by motion, on a small budget.

Prints the single-step error (MSE of the normalised next state) of the simulator, of baselines and
of ours under several uses of the simulator, for each motion that validates or tests, and the share
of it that the fastest tenth of the samples has. A smoother that sees both sides of each sample, a
polynomial through its neighbours without the sample itself, leaves what no prediction from the past
tells where a motion is smooth: quantization, and samples that were taken a little early or late.
Choices are made on validation motions.

Usage: python benchmarks/so101.py [--recordings DIR] [--model DIAGNOSIS] [--seed S]
           [--baselines NAME …] [--uses USE …]
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from wt.config import FitConfig, load, vary
from wt.data.transitions import Pairs
from wt.fit import on_model
from wt.run.study import Study
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.score import PairTensors, predictions

Array = np.ndarray

CONF = Path(__file__).resolve().parents[1] / "conf" / "so101.yaml"
SMALL = (
    "data.transitions=30000", "plus.mean.members=1", "plus.mean.steps=2000", "plus.mean.width=128",
    "plus.train.steps=250", "plus.train.validate_every=250", "plus.train.batch=256",
    "plus.nets.width=64", "plus.nets.translator_width=64", "baselines.members=1",
    "baselines.steps=2000", "baselines.width=128",
)  # fmt: skip
SPLITS = ("validation", "test")


def motions(config: FitConfig, split: str) -> tuple[str, ...]:
    """Names of the motions of a split, in the order of their episodes."""
    from wt.worlds.so101 import SO101Options

    given: tuple[str, ...] = config.world.get(split, getattr(SO101Options, split))
    return given


def smoothed(x: Array, half: int, degree: int) -> Array:
    """Samples (time, joint) by a polynomial through the ``half`` before and after each."""
    t = np.r_[-half:0, 1 : half + 1]
    weight = np.linalg.pinv(np.vander(t, degree + 1, increasing=True))[0]
    kernel = np.insert(weight, half, 0.0)[::-1]
    return np.stack([np.convolve(column, kernel, "valid") for column in x.T], axis=1)


def floor(positions: Array, rate: float, speed: Array) -> float:
    """MSE of the best of some smoothers; a velocity errs by its position's error times the rate."""
    found = []
    for half, degree in itertools.product((2, 3, 4), (2, 3, 4)):
        if degree < 2 * half:
            left = positions[half:-half] - smoothed(positions, half, degree)
            found.append(
                0.5 * float(np.mean((left * rate / speed) ** 2))
            )  # positions weigh nothing
    return min(found)


def by_motion(study: Study, pairs: Pairs, predicted: Array) -> str:
    """MSE of all pairs, of each motion's, and the share of the fastest tenth."""
    error = np.mean(((predicted - pairs.real.s_next) / study.scales.state) ** 2, axis=1)
    episode, n = pairs.real.episode, len(study.world.spec.pose)
    speed = np.linalg.norm(pairs.real.s_next[:, n:], axis=1)
    fast = error[speed > np.quantile(speed, 0.9)].sum() / error.sum()
    each = (float(error[episode == k].mean()) for k in np.unique(episode))
    return " ".join(f"{mse:.4f}" for mse in (error.mean(), *each)) + f" fastest tenth {fast:.0%}"


def told(study: Study, name: str, answers: tuple[Array, Array], began: float) -> None:
    """Print a row: validation motions, then test motions."""
    data = study.data
    assert data.validation is not None
    both = zip((data.validation, data.test), answers, strict=True)
    cells = " | ".join(by_motion(study, pairs, answer) for pairs, answer in both)
    print(f"{name:34s} {cells}  ({time.perf_counter() - began:.0f} s)", flush=True)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", default=str(CONF.parents[2] / "shared/recordings/so101"))
    parser.add_argument("--model", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--baselines", nargs="*", default=["DirectPred", "RSSM", "ResDynSim"])
    parser.add_argument("--uses", nargs="*", default=["ignored", "blend"])
    given = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as home:
        words = [*SMALL, f"world.recordings={given.recordings}", f"data.dir={home}/data"]
        config = load(CONF, words)
        config = on_model(config, given.model) if given.model else config
        study = Study.open(config, Path(home))
        compare(study, Path(home), given.seed, given.baselines, given.uses)


def compare(study: Study, home: Path, seed: int, baselines: list[str], uses: list[str]) -> None:
    """Print all rows."""
    data, world = study.data, study.world
    assert data.validation is not None
    both = data.validation, data.test
    print("all, then", " | ".join(", ".join(motions(study.config, split)) for split in SPLITS))
    n, rate, speed = len(world.spec.pose), world.spec.rate_hz, study.scales.state
    floors = [
        [floor(p.real.s_next[p.real.episode == k, :n].astype(float), rate, speed[n:])
         for k in np.unique(p.real.episode)]
        for p in both
    ]  # fmt: skip
    cells = " | ".join(" ".join(f"{mse:.4f}" for mse in row) for row in floors)
    print(f"{'smoother of both sides, by motion':34s} {cells}", flush=True)
    now = time.perf_counter()
    told(study, "RawSim", (both[0].sim_next, both[1].sim_next), now)
    sim, real, selection, _ = study.split
    for name in baselines:
        now, baseline = time.perf_counter(), study.baseline(seed, name)
        baseline.train(sim, real, selection)
        told(study, name, (baseline.predict(both[0]), baseline.predict(both[1])), now)
    for use in uses:
        now, method = time.perf_counter(), vary(study.config.plus, [f"mean.simulator={use}"])
        model = fit_world_model(
            TrainingInput(
                world.spec, method, sim, real, selection, seed, home / use, simulator=world
            )
        )
        scales = model.frame.state.std, model.frame.change.std
        tensors = (PairTensors.of(pairs, *scales) for pairs in both)
        first, second = (predictions(model, pairs).numpy() for pairs in tensors)
        told(study, f"ours, simulator: {use}", (first, second), now)


if __name__ == "__main__":
    main()
