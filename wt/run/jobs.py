"""Training every method with every seed, side by side on the machine's cores.

Workers read the collections from disk, and leave their results in the run's folder; see
:mod:`wt.run.pool`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import yaml

from wt.baselines.base import Source, find
from wt.config import FitConfig, Method, parse, to_yaml, vary
from wt.data.transitions import digest
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.nets.simulator_use import use_of
from wt.run.pool import Begin, at_once, side_by_side
from wt.run.study import Listener, Study
from wt.schema import flat
from wt.train import fit
from wt.train.data import TranslationData
from wt.train.device import device_of, on
from wt.train.module import WorldTranslation
from wt.train.score import PairTensors, predictions

_TRAINING = {
    "sim": ("sim", "training"),
    "real": ("real", "training"),
    "pairs": ("real", "training, as pairs"),
    "lessons": ("lessons", "training"),
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

        Not every world has lessons. What is held out without pairs is of the collections that are
        trained on.
        """
        if self.method in (OURS, PAPERS_OWN):
            asks = use_of(self.settings(config).mean).asks_simulator
            trained_on: tuple[Source, ...] = (*BOTH, "lessons") if asks else BOTH
        else:
            trained_on = find(self.method).trains_on
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
    workers = study.config.workers
    begin: Begin[Job, None] = functools.partial(_opened, to_yaml(study.config), str(study.folder))
    if at_once(workers, len(todo)) == 1:  # this process, which has it open
        begin = functools.partial(_open_already, study)
    side_by_side(todo, workers, begin, study.listener, lambda _, done: done.result())


def _opened(config: str, folder: str, listener: Listener, index: int) -> Callable[[Job], None]:
    fit = parse(FitConfig, yaml.safe_load(config), "")
    study = Study.open(fit, Path(folder), listener)
    return functools.partial(train, study, index=index)


def _open_already(study: Study, listener: Listener, index: int) -> Callable[[Job], None]:
    return functools.partial(train, study, index=index)


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
        lessons=study.data.lessons,
    )
