"""Training every method with every seed, side by side on the machine's cores.

Networks of this size gain little from several threads, and on a busy machine threads that wait
for one another lose much; so every job has one thread and a process of its own. Workers read the
collections from disk, report through a queue, and leave their results in the run's folder.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
from collections.abc import Mapping, Sequence
from multiprocessing.pool import AsyncResult
from pathlib import Path
from typing import Any, NamedTuple

import torch
import yaml

from wt.baselines.base import find
from wt.config import Fit, parse, to_yaml
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.study import Study
from wt.train.fit import fit_world_model
from wt.train.score import PairTensors, predictions

POLL_SECONDS = 0.2


class Job(NamedTuple):
    """One method with one seed."""

    seed: int
    method: str

    def __str__(self) -> str:
        """As shown beside a progress bar."""
        return f"{self.method}, seed {self.seed}"


def run_jobs(study: Study, jobs: Sequence[Job]) -> None:
    """Train every method that has not been, and keep what each predicts for the test pairs.

    Args:
        study: the run.
        jobs: longest first, so that no core waits for a last long one.
    """
    todo = [job for job in jobs if not study.finished(*job)]
    workers = min(study.config.workers or os.cpu_count() or 1, len(todo))
    if workers <= 1:
        torch.set_num_threads(1)
        for job in todo:
            train(study, job)
        return
    context = multiprocessing.get_context("spawn")
    messages = context.Queue()
    arguments = (to_yaml(study.config), str(study.folder), messages)
    with context.Pool(workers, _open, arguments) as pool:
        pending: list[AsyncResult[None]] = [pool.apply_async(_train, (job,)) for job in todo]
        while pending:
            _hand_on(messages, study)
            ended = [result for result in pending if result.ready()]
            pending = [result for result in pending if not result.ready()]
            for result in ended:
                result.get()  # raises what the job raised
        _hand_on(messages, study)


def train(study: Study, job: Job) -> None:
    """Train one method and keep its prediction."""
    seed, method = job
    data, config = study.data, study.config
    listener = study.listener
    if method not in (OURS, PAPERS_OWN):
        baseline = find(method)(study.world.spec, config.baselines, seed)
        baseline.train(
            data.sim, data.real, data.validation, lambda k, n: listener.progress(str(job), k, n)
        )
        study.keep(seed, method, baseline.predict(data.test))
        return
    model = fit_world_model(
        study.world.spec,
        config.plus if method == OURS else config.paper,
        data.sim,
        data.real,
        data.validation,
        seed,
        study.home(seed, method),
        sink=lambda values, step: listener.metrics(
            {f"{method}/seed{seed}/{k}": v for k, v in values.items()}, step
        ),
        warn=lambda line: listener.warn(f"{job}: {line}"),
        progress=lambda k, n: listener.progress(str(job), k, n),
    )
    study.keep_model(seed, method, model)
    tensors = PairTensors.of(data.test, model.frame.state.std, model.frame.change.std)
    study.keep(seed, method, predictions(model, tensors).numpy())


class _Sender:
    """The listener inside a worker: everything goes through the queue."""

    def __init__(self, messages: Any) -> None:  # noqa: ANN401 – a queue of a spawn context
        self._messages = messages

    def progress(self, what: str, done: int, total: int) -> None:
        self._messages.put(("progress", (what, done, total)))

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        self._messages.put(("metrics", (dict(values), step)))

    def warn(self, line: str) -> None:
        self._messages.put(("warn", (line,)))


_opened: list[Study] = []
"""The study of this worker process; filled once by ``_open``."""


def _open(config: str, folder: str, messages: Any) -> None:  # noqa: ANN401 – see _Sender
    # Ctrl-C reaches the parent, which ends its workers; checkpoints are whole at any moment
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    fit = parse(Fit, yaml.safe_load(config), "")
    _opened.append(Study.open(fit, Path(folder), _Sender(messages)))


def _train(job: Job) -> None:
    train(_opened[0], Job(*job))


def _hand_on(messages: Any, study: Study) -> None:  # noqa: ANN401 – see _Sender
    """Pass on what workers said, waiting a moment for something to be said."""
    try:
        while True:
            kind, arguments = messages.get(timeout=POLL_SECONDS)
            getattr(study.listener, kind)(*arguments)
    except queue.Empty:
        return
