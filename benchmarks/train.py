"""Training speed: what ``wt fit`` runs against the same losses in a bare PyTorch loop.

Both sides train the paper's model at the size of R5 on the same batches with the same optimizers.
The bare loop does no more than that: no learning-rate schedule, no hooks, no metrics, no
checkpoints. Since a shared machine drifts, the sides take turns of a few dozen steps: whenever
``wt fit`` logs, the bare loop takes as many steps, and medians are over turns. The first turn of
each warms up; set-up and validation are outside. One thread a process, as in ``wt fit``'s workers.

A line for each way to train that this machine has: one process and two on CPU cores, and on CUDA
devices one (also compiled, and with CUDA graphs) and, where there are more, two. Processes share
each batch, so that their steps compare; the bare loop is always alone, on the first of the devices,
and told kernel by kernel.

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
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from wt.config import Device, Method, load
from wt.nets.world_model import WorldModel
from wt.train import phases
from wt.train.batches import Held, StepBatches, in_frame
from wt.train.device import device_of, on
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.mean_field import fit_normalizers
from wt.train.selection import Unpaired
from wt.types import Transitions, TransitionSpec
from wt.worlds.base import make

TURN, TURNS, ROWS = 50, 13, 50_000


class Way(NamedTuple):
    """How to train: on what, by how many processes, compiled or not, with CUDA graphs or not."""

    device: Device
    processes: int
    compiled: bool = False
    graphs: bool = False

    def __str__(self) -> str:
        """As a line of the table begins."""
        where = "CPU, {} process" if self.device == "cpu" else "CUDA, {} device"
        plural = "" if self.processes == 1 else "es" if self.device == "cpu" else "s"
        more = ", graphs" * self.graphs + ", compiled" * self.compiled
        return where.format(self.processes) + plural + more


def main(config_path: str = "conf/r5.yaml", *overrides: str) -> None:
    """Print the table."""
    torch.set_num_threads(1)
    config = load(config_path, overrides)
    spec, method = make(config.world).spec, config.paper
    print(
        f"{spec.task}: {spec.n_obs} + {spec.n_action} → {spec.n_state} channels, "
        f"batch {method.train.batch}, {TURNS - 1} turns of {TURN} steps"
    )
    print(f"{'':<26}{'wt fit [steps/s]':>18}{'bare PyTorch':>14}{'ratio (goal ≥ .95)':>20}")
    for way in ways():
        with on(device_of(way.device)):
            turns = race(spec, _set(method, way))
        ours, theirs = (TURN / statistics.median(side) for side in zip(*turns, strict=True))
        ratio = statistics.median(theirs / ours for ours, theirs in turns)
        print(f"{way!s:<26}{ours:>18.1f}{theirs:>14.1f}{ratio:>20.3f}", flush=True)


def ways() -> list[Way]:
    """What this machine can do."""
    found = [Way("cpu", 1), Way("cpu", 2)]
    if torch.cuda.is_available():
        found += [Way("cuda", 1), Way("cuda", 1, graphs=True)]
        found += [Way("cuda", 1, compiled=True), Way("cuda", 1, compiled=True, graphs=True)]
        found += [Way("cuda", 2), Way("cuda", 2, graphs=True)] * (torch.cuda.device_count() > 1)
    return found


def _set(method: Method, way: Way) -> Method:
    """A method that trains for as long as is measured, and in this way."""
    steps = TURN * TURNS
    train = replace(
        method.train,
        steps=steps,
        validate_every=steps,
        log_every=TURN,
        devices=way.processes,
        compile=way.compiled,
        cuda_graphs=way.graphs,
    )
    return replace(method, train=train)


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
        fit_world_model(
            TrainingInput(spec, method, sim, real, selection, 0, Path(folder)), sink=sink
        )
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
        of_sim, of_real = (Held(data) for data in in_frame(m.frame, sim, real))
        self.batches = iter(StepBatches(of_sim, of_real, method.train.batch, method.nets.latent, 0))

        def adam(rate: float, *modules: nn.Module) -> torch.optim.Adam:
            return torch.optim.Adam([p for m in modules for p in m.parameters()], rate, fused=True)

        rate, gan_rate = method.train.learning_rate, method.train.gan_learning_rate
        self.vae = adam(rate, m.encoder, m.decoder, m.classifier)
        self.blind = adam(rate, m.blind)
        self.generators = adam(gan_rate, m.to_real, m.to_sim)
        self.discriminators = adam(gan_rate, m.discriminator_real, m.discriminator_sim)

    def run(self, steps: int) -> float:
        """Seconds that so many steps take."""
        wait_for_device()
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
        wait_for_device()
        return time.perf_counter() - start


def wait_for_device() -> None:
    """Wait until a CUDA device has done what it was told: it is told ahead of what it does."""
    if torch.get_default_device().type == "cuda":
        torch.cuda.synchronize()


def update(optimizer: torch.optim.Adam, loss: Tensor) -> None:
    """One optimizer step."""
    optimizer.zero_grad()
    loss.backward(inputs=optimizer.param_groups[0]["params"])
    optimizer.step()


if __name__ == "__main__":
    main(*sys.argv[1:])
