"""All trainings of a run, side by side: each is fine-tuned, exported, and judged in R."""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch

from wt.errors import one_line
from wt.finetune.config import Finetune, Variant
from wt.finetune.evaluate import Downstream, evaluate
from wt.finetune.setting import Setting
from wt.finetune.training import adapt
from wt.locomotion.export import Origin
from wt.run.pool import at_once, side_by_side
from wt.run.study import Listener
from wt.train.device import device_of

GRACE_SECONDS = 30.0
"""Time in which trainings that are interrupted have put their checkpoints away."""


class Job(NamedTuple):
    """One training.

    Attributes:
        variant: how.
        seed: of it.
    """

    variant: Variant
    seed: int

    def __str__(self) -> str:
        """Name of its folder, and as shown."""
        return f"{self.variant}-seed{self.seed}"


class Judged(NamedTuple):
    """What came of a training.

    Attributes:
        figures: in R.
        updates: of the policy, in all.
    """

    figures: Downstream
    updates: int


@dataclass(frozen=True)
class Orders:
    """What a process is told that trains; it can be pickled.

    Attributes:
        config: of the run.
        folder: of the run.
        origin: what makes the policies, for their cards.
        until: no update begins after this moment [s since the epoch]; None for no limit.
        threads: of a training whose number the configuration leaves open; 0 for one per core.
    """

    config: Finetune
    folder: Path
    origin: Origin
    until: float | None = None
    threads: int = 0


def jobs_of(config: Finetune) -> list[Job]:
    """The trainings, seed by seed, so that a run that is cut short has all variants of a seed.

    The base policy needs no training and stands there once.
    """
    first = config.seeds[0]
    return [
        Job(variant, seed)
        for seed in config.seeds
        for variant in config.variants
        if variant != "none" or seed == first
    ]


def threads_of_each(workers: int, jobs: int, processes: int) -> int:
    """Threads of a training's simulation: its share of the cores; 0, all of them, if alone.

    Args:
        workers: as configured.
        jobs: number of trainings.
        processes: that each has its environment in.
    """
    running = at_once(workers, jobs)
    if running <= 1:
        return 0
    return max(1, (os.cpu_count() or 1) // (running * processes))


def model_home(folder: Path, variant: Variant) -> Path:
    """Folder of the model that a variant translates with, in that of the run."""
    return folder / f"model-{variant}"


def train_all(
    orders: Orders,
    jobs: Sequence[Job],
    listener: Listener,
    done: Callable[[Job, Judged], None],
) -> dict[Job, Exception]:
    """Do all trainings; an error ends the one that it is in, and the others go on.

    Args:
        orders: for all of them.
        jobs: which.
        listener: told how far each is, and of errors.
        done: told of each that came to an end, in this process.

    Returns:
        What went wrong.

    Raises:
        WorkError: a process was killed from outside.
    """
    failed: dict[Job, Exception] = {}

    def ended(job: Job, future: Future[Judged | None]) -> None:
        error = future.exception()
        if isinstance(error, Exception):
            failed[job] = error
            listener.warn(f"{job}: {one_line(error)}")
            return
        judged = future.result()
        if judged is None:
            listener.warn(f"{job}: no update began in time")
        else:
            done(job, judged)

    workers, begin = orders.config.workers, functools.partial(begin_work, orders)
    side_by_side(jobs, workers, begin, listener, ended, grace=GRACE_SECONDS)
    return failed


def begin_work(orders: Orders, listener: Listener, index: int) -> Callable[[Job], Judged | None]:
    """What does trainings in a process, the ``index``-th of its like; GPUs take them in turn."""
    setting = Setting.of(orders.config, orders.threads)
    device = device_of(setting.training("none", 0).device, index)
    if device.type == "cuda":
        torch.cuda.set_device(device)
    return functools.partial(_judged, orders, setting, listener)


def _judged(orders: Orders, setting: Setting, listener: Listener, job: Job) -> Judged | None:
    """Train, export and judge in R; None where no update began in time."""
    name, config = str(job), setting.config
    policy, updates, total = setting.base, 0, 1  # what is judged counts as the last update
    if job.variant != "none":
        total += setting.training(job.variant, job.seed).ppo.iterations

        def progress(done: int, _: int, row: Mapping[str, float]) -> None:
            listener.progress(name, done, total)
            listener.metrics(name, row, done)

        model = model_home(orders.folder, job.variant)
        seconds = None if orders.until is None else max(0.0, orders.until - time.time())
        adapted = adapt(
            setting, job.variant, job.seed, orders.folder / name,
            model if model.exists() else None, orders.origin, progress, seconds,
        )  # fmt: skip
        if adapted is None:
            return None
        policy, updates = adapted, int(adapted.card.training["iterations"])
    herd = setting.reality(config.evaluation.episodes)
    figures = evaluate(herd, policy, config.evaluation.commands, config.evaluation.seed)
    listener.progress(name, total, total)
    return Judged(figures, updates)
