"""Speed of walking robots: training environment and policy in the loop against bare stepping.

Both sides of a row take the same number of physics steps with the same number of simulations on
as many threads. The bare side writes targets once per control step and nothing else: no
observation, reward, policy or sensor at the feet. Contacts cost by how a robot moves, so the bare
side replays the other's motion: it starts in the same states, gets the same targets, and where the
environment pushed robots or started them anew, it is given their new states. Every turn is the same
motion once more. The sides take turns, and the table shows the median of each and of the shares of
neighbouring turns, since a shared machine drifts; the last column is the share by processor time,
which drifts less. Models are made outside. Robots without a policy in the package have one row.

Usage: python benchmarks/envs.py [ROBOTS [STEPS [TURNS [THREADS]]]]    the long form: 256 100 5 1
       python benchmarks/envs.py --short    half a minute: 64 50 3 1
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from wt.batch import Batch
from wt.locomotion.config import PolicyConfig, load
from wt.locomotion.env import Walking, sample_commands
from wt.worlds.legged import TIMESTEP, Herd
from wt.worlds.policy import SHIPPED, Policy

Array = np.ndarray
Work = Callable[[], None]

NAMES = ("go2", "go2_payload", "g1", "g1_uneven")
NOISE = 0.3  # of the random actions, in units of the action scale
SHORT = ("64", "50", "3")
WARM_UP = 25  # control steps before anything is recorded


def main(robots: str = "256", steps: str = "100", turns: str = "5", threads: str = "1") -> None:
    """Print the table."""
    torch.set_num_threads(1)
    print(
        f"{robots} robots, {steps} control steps a turn, {turns} turns, {threads} physics threads; "
        "steps are control steps of one robot"
    )
    print(f"{'':<34}{'bare steps/s':>14}{'wt steps/s':>14}{'share':>8}{'of CPU':>8}  (goal ≥ 80 %)")
    for name in NAMES:
        config = load(f"conf/policy_{name}.yaml")
        config = replace(config, robots=int(robots), threads=int(threads))
        work, herd = environment(config, int(steps))
        compare(f"{name}: training environment", config, work, herd, int(turns))
        if (SHIPPED / name).is_dir():
            work, herd = policy_in_the_loop(config, name, int(steps))
            compare(f"{name}: policy in the loop", config, work, herd, int(turns))


def environment(config: PolicyConfig, steps: int) -> tuple[Work, Herd]:
    """A turn of the environment under random actions, and its robots."""
    env = Walking(config, "cpu")
    generator = torch.Generator().manual_seed(0)
    actions = NOISE * torch.randn(steps, env.num_envs, env.num_actions, generator=generator)

    for action in actions[:WARM_UP]:
        env.step(action)
    herd, lengths = env.herd, env.episode_length_buf.clone()
    qpos, qvel = herd.qpos.copy(), herd.qvel.copy()

    def work() -> None:
        herd.qpos[:], herd.qvel[:] = qpos, qvel
        env.episode_length_buf[:] = lengths
        env._rng = np.random.default_rng(0)
        for action in actions:
            env.step(action)

    return work, herd


def policy_in_the_loop(config: PolicyConfig, name: str, steps: int) -> tuple[Work, Herd]:
    """A turn of a policy with a herd under commands of all kinds, and its robots."""
    robot, rng = config.body(), np.random.default_rng(0)
    policy = Policy.load(name, robot, config.physics)
    model = robot.describe(config.physics or robot.physics, TIMESTEP, config.scene).compile()
    herd = Herd(robot, model, config.robots, config.scene, config.threads)
    herd.reset(np.arange(herd.size), rng, config.episodes.start)
    command = sample_commands(config.commands, herd.size, rng)
    clock = policy.clock(herd.size)

    for _ in range(WARM_UP):
        herd.step(policy.act(herd.observe(), command, clock.read(herd.time, command)))
    qpos, qvel, last = herd.qpos.copy(), herd.qvel.copy(), herd.action.copy()

    def work() -> None:
        herd.qpos[:], herd.qvel[:], herd.action[:] = qpos, qvel, last
        for _ in range(steps):
            herd.step(policy.act(herd.observe(), command, clock.read(herd.time, command)))

    return work, herd


def compare(what: str, config: PolicyConfig, work: Work, herd: Herd, turns: int) -> None:
    """Print a row: bare stepping, a side of ours, and its share of bare speed."""
    bare, steps = replay(config, work, herd)
    taken = [(*seconds(bare), *seconds(work)) for _ in range(turns)]
    share, of_cpu = (statistics.median(turn[i] / turn[i + 2] for turn in taken) for i in (0, 1))
    theirs, ours = (herd.size * steps / statistics.median(t[i] for t in taken) for i in (0, 2))
    print(f"{what:<34}{theirs:>14.0f}{ours:>14.0f}{share:>8.1%}{of_cpu:>8.1%}", flush=True)


def replay(config: PolicyConfig, work: Work, herd: Herd) -> tuple[Work, int]:
    """A turn of bare stepping through the motion of one turn of ours, and its control steps."""
    before: list[tuple[Array, Array]] = []
    after: list[tuple[Array, Array]] = [(np.empty(0), np.empty(0))]
    targets: list[Array] = []
    step = herd.step

    def recorded(action: Array) -> None:
        before.append((herd.qpos.copy(), herd.qvel.copy()))
        step(action)
        after.append((herd.qpos.copy(), herd.qvel.copy()))
        targets.append(herd.ctrl.copy())

    herd.step = recorded  # type: ignore[method-assign]
    work()
    herd.step = step  # type: ignore[method-assign]
    rows = [np.arange(herd.size)]
    for then, now in zip(after[1:-1], before[1:], strict=True):
        changed = [(a != b).any(axis=1) for a, b in zip(then, now, strict=True)]
        rows.append(np.flatnonzero(changed[0] | changed[1]))
    jumps = [(ids, q[ids], v[ids]) for ids, (q, v) in zip(rows, before, strict=True)]
    robot = config.body()
    model = robot.describe(config.physics or robot.physics, TIMESTEP, config.scene).compile()
    batch, substeps = Batch(model, herd.size, config.threads), round(herd.dt / TIMESTEP)
    qpos, qvel, ctrl = batch.qpos, batch.qvel, batch.ctrl

    def bare() -> None:
        for (ids, q, v), target in zip(jumps, targets, strict=True):
            if len(ids):
                qpos[ids], qvel[ids] = q, v
            ctrl[:] = target
            batch.step(nstep=substeps)

    bare()
    apart = np.abs(qpos - after[-1][0]).max(axis=1)
    if (np.median(apart) > 0.01) or not np.isfinite(apart).all():
        print(f"(the replay of {config.name} is {np.median(apart):.3f} apart: it moves otherwise)")
    return bare, len(targets)


def seconds(work: Work) -> tuple[float, float]:
    """Wall time of a call, and processor time of all its threads [s]."""
    start, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - start, time.process_time() - cpu


if __name__ == "__main__":
    main(*(SHORT if sys.argv[1:] == ["--short"] else sys.argv[1:]))
