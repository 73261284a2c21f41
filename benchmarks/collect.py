"""Collection speed: R5 Force in closed loop against bare ``mujoco.batch`` stepping.

Both sides take the same number of physics steps with the same number of simulations, batch after
batch. The bare side writes a target once per control step and nothing else: no policy, no force,
nothing stored. The sides take turns, and the table shows the median of each and of the overhead
of neighbouring turns, since a shared machine drifts. The nominal pass (S's answer to every stored
(o, a), which Transitions carry) and the planning of reference motions (once per process) are
lines of their own.

Usage: python benchmarks/collect.py [CONFIG] [key=value …]
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from mujoco.batch import Batch

from wt.config import load
from wt.types import Domain
from wt.worlds.base import make
from wt.worlds.r5 import R5Options, R5World

ROWS, TURNS = 100_000, 3
DOMAINS: tuple[Domain, ...] = ("sim", "real")


def main(config_path: str = "conf/r5.yaml", *overrides: str) -> None:
    """Print the table."""
    world = make(load(config_path, overrides).world)
    assert isinstance(world, R5World), "this benchmark knows the R5 only"
    options = world._options
    planning = seconds(world._routes)
    print(
        f"{world.spec.task}: {ROWS} transitions a turn, {options.arms} arms, {TURNS} turns, "
        f"{substeps(options)} physics steps a transition, threads {options.threads or 'per core'}"
    )
    print(f"{'':<36}{'seconds':>10}{'transitions/s':>16}{'overhead':>10}")
    for domain in DOMAINS:
        compare(world, domain)
    a = np.resize(world._routes().reshape(-1, 6), (ROWS, 6))
    o = np.concatenate([a, np.zeros_like(a), a], axis=1)
    nominal = statistics.median(seconds(lambda: world.sim_step(o, a, None)) for _ in range(TURNS))
    line("nominal pass of the simulator", nominal)
    print(f"{'planning of reference motions, once':<36}{planning:>10.2f}")


def compare(world: R5World, domain: Domain) -> None:
    """Print one domain's lines: bare stepping, then the closed loop and what it costs more."""
    turns = [
        (seconds(lambda: bare(world, domain)), seconds(lambda: closed_loop(world, domain)))
        for _ in range(TURNS)
    ]
    overhead = statistics.median(ours / theirs for theirs, ours in turns) - 1
    theirs, ours = (statistics.median(side) for side in zip(*turns, strict=True))
    line(f"{domain}: bare mujoco.batch", theirs)
    line(f"{domain}: wt, closed loop (goal ≤ 30 %)", ours, f"{overhead:>9.1%}")


def closed_loop(world: R5World, domain: Domain) -> None:
    """What ``R5World.collect`` does, less the nominal pass."""
    nominal, world_step = np.zeros((ROWS, world.spec.n_state), np.float32), world.sim_step
    world.sim_step = lambda *_: nominal  # type: ignore[method-assign]
    try:
        world.collect(domain, ROWS, seed=0)
    finally:
        world.sim_step = world_step  # type: ignore[method-assign]


def bare(world: R5World, domain: Domain) -> None:
    """As many physics steps of as many simulations along the same motions, and no more."""
    options, routes = world._options, world._routes()
    rng = np.random.default_rng(0)
    for _ in range(ROWS // (options.arms * options.episode_steps)):
        route = rng.integers(len(routes), size=options.arms)
        start = rng.integers(routes.shape[1] - options.episode_steps - 1, size=options.arms)
        batch = Batch(world.model(domain), options.arms, options.threads)
        qpos, ctrl = batch.qpos, batch.ctrl
        qpos[:] = routes[route, start]
        for k in range(options.episode_steps):
            ctrl[:] = routes[route, start + k]
            batch.step(nstep=substeps(options))


def substeps(options: R5Options) -> int:
    """Physics steps of one control step."""
    return round(1.0 / (options.rate_hz * options.timestep))


def seconds(work: Callable[[], object]) -> float:
    """Wall time of a call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def line(what: str, took: float, more: str = "") -> None:
    """Print a row of the table."""
    print(f"{what:<36}{took:>10.2f}{ROWS / took:>16.0f}{more}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
