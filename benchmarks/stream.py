"""Training on data that memory does not hold: two workers of ``wt fit``, one of which streams.

Both run the same job as ``wt fit`` does: they open their collections, train with one thread, and
predict the test pairs. One has so many million transitions, S's and R's together, of which it
holds ``data.in_memory`` of either at a time; the other has no more than those. They are
noise in the layout of an R5, the same in every shard, since speed does not depend on what they say.
Since a shared machine drifts, the workers take turns. In each of them the one that streams reads
one row group of either domain. The first turn warms up, and medians are over the others, of the
time that passed, of the time that the worker had a core, and of the part of this in which it read
row groups and brought them into the frame. Memory is the peak of the resident set of the whole
process, with all that it imports.

Usage: python benchmarks/stream.py [MILLIONS] [key=value …]    the long form: 50 million, 7 turns
       python benchmarks/stream.py --short    two minutes: a million, 100,000 in memory, 3 turns
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from wt.config import FitConfig, Method, load
from wt.data.transitions import ROW_GROUP
from wt.evaluate.results import PAPERS_OWN
from wt.run.jobs import Job, train
from wt.run.study import Study
from wt.train import streamed
from wt.train.batches import DomainData
from wt.train.streamed import DRAWS, Streamed
from wt.types import Domain, Pairs, Transitions
from wt.worlds.base import Progress, register
from wt.worlds.r5 import R5World

TURNS = 7
SHORT = ("1", "data.in_memory=100000")
SHORT_TURNS = 3

Time = Float[np.ndarray, "*turn clock=3"]


@register("noise")
class NoiseWorld(R5World):
    """An R5 whose transitions are noise."""

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """The same for any seed."""
        return noise(self.spec.n_obs, self.spec.n_action, self.spec.n_state, count)

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """The same, with noise for S's answers."""
        real = self.collect("real", count, seed)
        return Pairs(real, real.s_next[::-1])


@cache
def noise(observed: int, action: int, state: int, rows: int) -> Transitions:
    """Transitions in episodes of 200 steps."""
    rng, step = np.random.default_rng(0), np.arange(rows)
    o, a, s_next, nominal = (rng.normal(size=(rows, n)) for n in (observed, action, state, state))
    return Transitions(
        o=o, a=a, s_next=s_next, nominal=nominal, hidden=np.zeros((rows, 3)), episode=step // 200,
        step=step % 200,
    )  # fmt: skip


@dataclass(frozen=True)
class Turns:
    """The listener of a worker that takes turns: as metrics arrive, it waits for its next one."""

    other: Connection

    def progress(self, what: str, done: int, total: int) -> None:
        """Nobody looks."""

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        """A turn is over."""
        if not any(name.startswith("val/") for name in values):
            self.other.send(clocks())
            self.other.recv()
            self.other.send(clocks())

    def warn(self, line: str) -> None:
        """Nobody looks."""


def clocks() -> Time:
    """Seconds that have passed, that this process had a core, and that it had it to read."""
    return np.array([time.perf_counter(), time.process_time(), TimedStream.seconds])


class TimedStream(Streamed):
    """A stream that counts the time in which its buffers move."""

    seconds = 0.0

    def _moved(self, turn: int) -> DomainData:
        began = time.process_time()
        buffer = super()._moved(turn)
        TimedStream.seconds += time.process_time() - began
        return buffer


def work(config: FitConfig, folder: Path, method: str, other: Connection) -> None:
    """A worker of ``wt fit``; says when its turns begin and end, and then how much it held."""
    torch.set_num_threads(1)
    streamed.Streamed = TimedStream  # type: ignore[misc]
    train(Study.open(config, folder, Turns(other)), Job(0, method))
    status = Path("/proc/self/status").read_text()
    other.send(int(status.split("VmHWM:")[1].split()[0]) / 1e6)


def race(
    method: str, configs: Sequence[FitConfig], folder: Path, turns: int
) -> list[tuple[Time, float]]:
    """Milliseconds per step in each turn of either worker, and gigabytes that it held."""
    context = multiprocessing.get_context("spawn")
    ours, steps = [], turn(configs[0].paper)
    for k, config in enumerate(configs):
        mine, theirs = context.Pipe()
        where = folder / f"{method}-{k}"
        context.Process(target=work, args=(config, where, method, theirs), daemon=True).start()
        mine.recv()  # warm
        ours.append(mine)
    times: list[list[Time]] = [[] for _ in configs]
    for _ in range(turns - 1):
        for side, worker in zip(times, ours, strict=True):
            worker.send(None)
            began = worker.recv()
            side.append(1000 * (worker.recv() - began) / steps)
    for worker in ours:
        worker.send(None)
        worker.recv()
    return [(np.array(side), worker.recv()) for side, worker in zip(times, ours, strict=True)]


def turn(method: Method) -> int:
    """Steps after which the buffer moves by a row group."""
    return DRAWS * ROW_GROUP // (2 * method.train.batch)


def configured(folder: Path, transitions: int, turns: int, overrides: Sequence[str]) -> FitConfig:
    """An R5 with so many transitions of either domain, trained for as many turns as there are."""
    config = load("conf/r5.yaml", [
        "world.name=noise", f"data.dir={folder / 'data'}", f"data.transitions={transitions}",
        *overrides,
    ])  # fmt: skip
    steps = turn(config.paper)
    train = replace(
        config.paper.train, steps=turns * steps, validate_every=turns * steps, log_every=steps
    )
    return replace(config, paper=replace(config.paper, train=train))


def main(millions: str = "50", *overrides: str) -> None:
    """Print the table."""
    turns = TURNS
    if millions == "--short":
        (millions, *few), turns = SHORT, SHORT_TURNS
        overrides = (*few, *overrides)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        large = configured(folder, int(float(millions) * 500_000), turns, overrides)
        configs = [configured(folder, large.data.in_memory, turns, overrides), large]
        for config in configs:
            Study.open(config, folder, Turns(multiprocessing.Pipe()[0]))
        times = f"{'ms/step':>9}{'ratio':>7}{'of a core':>11}{'ratio':>7}{'to read':>9}"
        print(f"{'':<22}{'transitions':>12}{times}{'peak GB':>9}")
        results = race(PAPERS_OWN, configs, folder, turns)
        (memory, _), _ = results
        for config, (side, held) in zip(configs, results, strict=True):
            wall, core, reading = np.median(side, axis=0)
            ratios = np.median(side[:, :2] / memory[:, :2], axis=0)
            times = f"{wall:>9.2f}{ratios[0]:>7.3f}{core:>11.2f}{ratios[1]:>7.3f}{reading:>9.2f}"
            count = 2 * config.data.transitions
            print(f"{PAPERS_OWN:<22}{count:>12}{times}{held:>9.2f}", flush=True)
        print(f"{'goals':<22}{'':>12}{'':>9}{'≤ 1.05':>7}{'':>11}{'≤ 1.05':>7}{'':>9}{'< 2':>9}")


if __name__ == "__main__":
    main(*sys.argv[1:])
