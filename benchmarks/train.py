"""Training speed: what ``wt fit`` runs against the same losses in a bare PyTorch loop.

Both sides train the paper's model at the size of R5 on the same batches with the same optimizers.
The bare loop does no more than that: no learning-rate schedule, no hooks, no metrics, no
checkpoints. Since a shared machine drifts, the sides take turns of a few dozen steps: whenever
``wt fit`` logs, the bare loop takes as many steps, and medians are over turns. The first turn of
each warms up; set-up and validation are outside. One thread, as in each of ``wt fit``'s workers.

Usage: python benchmarks/train.py [CONFIG] [key=value …]
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from wt.config import Method, load
from wt.nets.world_model import WorldModel
from wt.train import phases
from wt.train.batches import StepBatches, in_frame
from wt.train.fit import fit_world_model
from wt.train.mean_field import fit_normalizers
from wt.train.selection import Unpaired
from wt.types import Transitions, TransitionSpec
from wt.worlds.base import make

TURN, TURNS, ROWS = 50, 13, 50_000


def main(config_path: str = "conf/r5.yaml", *overrides: str) -> None:
    """Print the table."""
    torch.set_num_threads(1)
    config = load(config_path, overrides)
    spec, method = make(config.world).spec, config.paper
    steps = TURN * TURNS
    method = replace(
        method, train=replace(method.train, steps=steps, validate_every=steps, log_every=TURN)
    )
    turns = race(spec, method)
    ours, theirs = (TURN / statistics.median(side) for side in zip(*turns, strict=True))
    ratio = statistics.median(theirs / ours for ours, theirs in turns)
    print(
        f"{spec.task}: {spec.n_obs} + {spec.n_action} → {spec.n_state} channels, "
        f"batch {method.train.batch}, {len(turns)} turns of {TURN} steps, one thread"
    )
    print(f"{'training loop':<24}{'steps/s':>10}")
    print(f"{'wt fit (Lightning)':<24}{ours:>10.1f}")
    print(f"{'bare PyTorch':<24}{theirs:>10.1f}")
    print(f"{'ratio (goal ≥ 0.9)':<24}{ratio:>10.3f}")


def race(spec: TransitionSpec, method: Method) -> list[tuple[float, float]]:
    """Seconds that Lightning and the bare loop took in each turn."""
    sim, real = noise(spec, 1), noise(spec, 2)
    bare, turns, resumed = Bare(spec, method, sim, real), [], time.perf_counter()

    def sink(metrics: Mapping[str, float], step: int) -> None:
        nonlocal resumed
        if any(name.startswith("val/") for name in metrics):
            return
        turns.append((time.perf_counter() - resumed, bare.run(TURN)))
        resumed = time.perf_counter()

    few = np.arange(256)
    selection = Unpaired(sim.select(few), real.select(few))
    with tempfile.TemporaryDirectory() as folder:
        fit_world_model(spec, method, sim, real, selection, 0, Path(folder), sink=sink)
    return turns[1:]


def noise(spec: TransitionSpec, seed: int) -> Transitions:
    """Transitions of the right shape; speed does not depend on what they say."""
    rng = np.random.default_rng(seed)
    return Transitions(
        o=rng.normal(size=(ROWS, spec.n_obs)),
        a=rng.normal(size=(ROWS, spec.n_action)),
        s_next=rng.normal(size=(ROWS, spec.n_state)),
        nominal=rng.normal(size=(ROWS, spec.n_state)),
        hidden=np.zeros((ROWS, len(spec.hidden))),
        episode=np.zeros(ROWS),
        step=np.arange(ROWS),
    )


class Bare:
    """Losses, backward passes and optimizer steps of Algorithm 1, and nothing else."""

    def __init__(
        self, spec: TransitionSpec, method: Method, sim: Transitions, real: Transitions
    ) -> None:
        """Build the same model, batches and optimizers."""
        torch.manual_seed(0)
        self.model = m = WorldModel(spec, method)
        fit_normalizers(m.frame, sim, real)
        data = in_frame(m.frame, sim, real)
        self.batches = iter(StepBatches(*data, method.train.batch, method.nets.latent, 0))

        def adam(rate: float, *modules: nn.Module) -> torch.optim.Adam:
            return torch.optim.Adam([p for m in modules for p in m.parameters()], rate, fused=True)

        rate, gan_rate = method.train.learning_rate, method.train.gan_learning_rate
        self.vae = adam(rate, m.encoder, m.decoder, m.classifier)
        self.blind = adam(rate, m.blind)
        self.generators = adam(gan_rate, m.to_real, m.to_sim)
        self.discriminators = adam(gan_rate, m.discriminator_real, m.discriminator_sim)

    def run(self, steps: int) -> float:
        """Seconds that so many steps take."""
        start = time.perf_counter()
        for _ in range(steps):
            batch = next(self.batches)
            loss, _, z = phases.extraction(self.model, batch)
            update(self.vae, loss)
            update(self.blind, phases.blind(self.model, batch, z)[0])
            z = phases.encode(self.model, batch)
            loss, _, fakes = phases.generators(self.model, batch.gan, *z)
            update(self.generators, loss)
            update(self.discriminators, phases.discriminators(self.model, batch.gan, *z, fakes)[0])
        return time.perf_counter() - start


def update(optimizer: torch.optim.Adam, loss: Tensor) -> None:
    """One optimizer step."""
    optimizer.zero_grad()
    loss.backward(inputs=optimizer.param_groups[0]["params"])
    optimizer.step()


if __name__ == "__main__":
    main(*sys.argv[1:])
