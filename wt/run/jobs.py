"""Training every method with every seed, side by side on the machine's cores.

Networks of this size gain little from several threads, and on a busy machine threads that wait
for one another lose much; so every job has one thread, and a process that it shares with no other.
Workers read the collections from disk, report through a queue, and leave their results in the
run's folder. They end with the run, however it ends: a worker that outlived it would write into
the folder that the resumed run works in.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import torch
import yaml

from wt.baselines.base import Source, find
from wt.config import FitConfig, Method, parse, to_yaml, vary
from wt.data.transitions import digest
from wt.errors import WorkError
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.run.study import Study
from wt.schema import flat
from wt.train import fit
from wt.train.data import TranslationData
from wt.train.device import device_of, on
from wt.train.module import WorldTranslation
from wt.train.replicas import end_with_parent
from wt.train.score import PairTensors, predictions

POLL_SECONDS = 0.2
_TRAINING = {
    "sim": ("sim", "training"),
    "real": ("real", "training"),
    "pairs": ("real", "training, as pairs"),
}
"""Collection of a source, and what a run in MLflow says that it is for."""
BOTH: tuple[Source, ...] = ("sim", "real")
"""What World Translation is trained on: neither Algorithm 1 nor a mean field reads pairs."""


class Job(NamedTuple):
    """One method with one seed.

    Attributes:
        seed: of training.
        method: a baseline's name, the paper's method or ours.
        changes: ``key=value`` words that make the last two a variant of themselves.
    """

    seed: int
    method: str
    changes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """As shown beside a progress bar."""
        return f"{', '.join([self.method, *self.changes])}, seed {self.seed}"

    @property
    def key(self) -> str:
        """Name under which the run's folder keeps it: the method's name, and a variant's hash."""
        return f"{self.method}-{digest(list(self.changes))}" if self.changes else self.method

    def parameters(self, config: FitConfig) -> dict[str, object]:
        """What its run in MLflow is compared by: method, seed and settings."""
        trained = self.method in (OURS, PAPERS_OWN)
        settings = flat(self.settings(config) if trained else config.baselines)
        settings.pop("names", None)  # of all baselines
        return {"method": self.method, "seed": self.seed, **settings}

    def uses(self, config: FitConfig) -> dict[str, str]:
        """Collections that it uses, by their names in :class:`Collected`, each with what for.

        What is held out without pairs is of the collections that are trained on.
        """
        own = self.method in (OURS, PAPERS_OWN)
        trained_on = BOTH if own else find(self.method).trains_on
        used = dict(_TRAINING[source] for source in trained_on)
        if used and config.model_selection == "pairs":  # who learns nothing, chooses nothing
            used["validation"] = "validation"
        return {**used, "test": "test"}

    def settings(self, config: FitConfig) -> Method:
        """Settings of a World Translation model, the paper's, ours or a variant."""
        return vary(config.plus if self.method == OURS else config.paper, self.changes)


def run_jobs(study: Study, jobs: Sequence[Job]) -> None:
    """Train every method that has not been, and keep what each predicts for the test pairs.

    Args:
        study: the run.
        jobs: longest first, so that no core waits for a last long one.

    Raises:
        WorkError: a worker was killed from outside.
    """
    todo = [job for job in jobs if not study.finished(job.seed, job.key)]
    workers = min(study.config.workers or os.cpu_count() or 1, len(todo))
    if workers <= 1:
        torch.set_num_threads(1)
        for job in todo:
            train(study, job)
        return
    context = multiprocessing.get_context("spawn")
    messages, places = context.Queue(), context.Queue()
    for index in range(workers):
        places.put(index)
    arguments = (to_yaml(study.config), str(study.folder), messages, places)
    with ProcessPoolExecutor(workers, context, _open, arguments) as pool, _killed_on_error():
        with _deaf_to_interrupts():
            pending = {_submit(pool, job) for job in todo}
        while pending:
            _hand_on(messages, study)
            ended, pending = wait(pending, timeout=0)
            for future in ended:
                future.result()  # raises what the job raised
        _hand_on(messages, study)


def _submit(pool: ProcessPoolExecutor, job: Job) -> Future[None]:
    """Give a job to the pool, which starts a worker for it where one is missing."""
    try:
        return pool.submit(_train, job)
    except OSError:
        # perhaps another worker has died, and the pool closed the pipes this one was to inherit
        pool.submit(_train, job)  # then it says so now: BrokenProcessPool
        raise


def train(study: Study, job: Job, index: int = 0) -> None:
    """Train one method and keep its prediction, in the process of an index among its like."""
    seed, method, _ = job
    sim, real, selection, _ = study.split
    config, listener = study.config, study.listener
    if method not in (OURS, PAPERS_OWN):
        with on(device_of(config.device, index, replayed=False)):
            baseline = study.baseline(seed, method)
            baseline.train(
                sim,
                real,
                selection,
                lambda k, n: listener.progress(str(job), k, n),
                lambda values, step: listener.metrics(str(job), values, step),
            )
        baseline.nets.cpu()
        study.keep_baseline(seed, baseline)
        study.keep(seed, method, baseline.predict(study.data.test))
        return
    with on(device_of(config.device, index)):
        model = fit.fit_world_model(
            _given(study, job),
            test=study.data.test,
            sink=lambda values, step: listener.metrics(str(job), values, step),
            warn=lambda line: listener.warn(f"{job}: {line}"),
            progress=lambda k, n: listener.progress(str(job), k, n),
        ).cpu()
    study.keep_model(seed, job.key, model)
    tensors = PairTensors.of(study.data.test, model.frame.state.std, model.frame.change.std)
    study.keep(seed, job.key, predictions(model, tensors).numpy())


def module_and_data(study: Study, job: Job) -> tuple[WorldTranslation, TranslationData]:
    """What trains a World Translation, for a ``lightning.Trainer`` of the caller's own.

    Args:
        study: of a configuration; its folder gets the fitted mean field.
        job: the paper's method, ours or a variant.
    """
    return fit.fitted(_given(study, job)).module_and_data(job.seed, study.data.test)


def _given(study: Study, job: Job) -> fit.TrainingInput:
    """What a World Translation is trained on."""
    sim, real, selection, streams = study.split
    return fit.TrainingInput(
        study.world.spec,
        job.settings(study.config),
        sim,
        real,
        selection,
        job.seed,
        study.home(job.seed, job.key),
        simulator=study.world,
        streams=streams,
    )


class _Sender:
    """The listener inside a worker: everything goes through the queue."""

    def __init__(self, messages: Any) -> None:  # noqa: ANN401 – a queue of a spawn context
        self._messages = messages

    def progress(self, what: str, done: int, total: int) -> None:
        self._messages.put(("progress", (what, done, total)))

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        self._messages.put(("metrics", (what, dict(values), step)))

    def warn(self, line: str) -> None:
        self._messages.put(("warn", (line,)))


_opened: list[tuple[Study, int]] = []
"""The study of this worker process, and its index; filled once by ``_open``."""


def _open(config: str, folder: str, messages: Any, places: Any) -> None:  # noqa: ANN401 – see _Sender
    end_with_parent()
    torch.set_num_threads(1)
    fit = parse(FitConfig, yaml.safe_load(config), "")
    _opened.append((Study.open(fit, Path(folder), _Sender(messages)), places.get()))


@contextmanager
def _killed_on_error() -> Iterator[None]:
    """End all workers at once when something goes wrong; checkpoints are whole at any moment."""
    try:
        yield
    except BaseException as error:
        for worker in multiprocessing.active_children():
            worker.kill()  # while it trains, Lightning would only take note of a SIGTERM
        if isinstance(error, BrokenProcessPool):
            raise WorkError(
                "a training process was killed from outside, perhaps for want of memory; "
                "continue with --resume, and with workers=1 if it happens again"
            ) from error
        raise


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started inside never see Ctrl-C: it is for the parent, which ends them.

    Blocked here and inherited, since a process that only ignored it once it is up would die with
    a traceback while it is still importing.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _train(job: Job) -> None:
    study, index = _opened[0]
    train(study, Job(*job), index)


def _hand_on(messages: Any, study: Study) -> None:  # noqa: ANN401 – see _Sender
    """Pass on the messages of workers, waiting a moment for the next."""
    try:
        while True:
            kind, arguments = messages.get(timeout=POLL_SECONDS)
            getattr(study.listener, kind)(*arguments)
    except queue.Empty:
        return
