"""The work of ``wt-finetune``: train every variant with every seed, evaluate all of them in R.

The folder of a run holds ``config.yaml``, ``results.json`` and ``results.md``, the models that it
translates with, and a folder for each variant and seed with what a training of wt-train-policy
leaves: policy, card, checkpoint, ``training.csv``, and ``rollout.rrd``, a recording of the policy
in R.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from registry.card import MODEL_FILE, Card
from registry.parity import verify
from registry.pull import bring
from registry.reference import is_folder
from wt.errors import one_line
from wt.finetune.config import Finetune, Variant
from wt.finetune.results import plain, save
from wt.finetune.setting import Setting
from wt.finetune.trainings import (
    Job,
    Judged,
    Orders,
    jobs_of,
    model_home,
    threads_of_each,
    train_all,
)
from wt.locomotion.export import Origin
from wt.locomotion.train import choose_device
from wt.registered import Registered
from wt.run.folder import CONFIG, RUN_ID, keep, tracked
from wt.run.study import Listener
from wt.run.track import NOTE, Run, machine


@dataclass(frozen=True)
class Outcome:
    """What came of a run.

    Attributes:
        results: as in ``results.json``; None where no policy could be judged.
        run: in MLflow; None where it is not tracked.
        failed: trainings that ended in an error.
    """

    results: dict[str, Any] | None
    run: Run | None
    failed: Mapping[Job, Exception]

    def errors(self) -> str:
        """What went wrong, in one line."""
        return "; ".join(f"{job}: {one_line(error)}" for job, error in self.failed.items())


def run(
    config: Finetune,
    folder: Path,
    *,
    made_by: str,
    listener: Listener,
    track: bool = False,
    minutes: float | None = None,
) -> Outcome:
    """Train what is not trained yet, evaluate every policy in R, and leave the table.

    Args:
        config: what is done, checked.
        folder: of the run; trainings found in it are continued, finished ones kept.
        made_by: the command line, for the cards.
        listener: told of progress.
        track: log to MLflow in any case, and not only with a model of its registry.
        minutes: time after which no further update begins [min]; None for no limit.

    Raises:
        ConfigError: the task, or what is said of the training, cannot be used.
        ModelError: policy or model do not fit the task.
        RegistryError: a model is not there, or not as it was registered or exported.
        WorkError: a training's process was killed from outside.
    """
    until = None if minutes is None else time.time() + 60.0 * minutes
    setting = Setting.of(config)
    training = setting.training("none", config.seeds[0])
    choose_device(training)
    models = _models(setting, folder)
    keep(config, folder)
    task, jobs = setting.world().spec.task, jobs_of(config)
    about = {
        "task": task,
        "policy": setting.base.card.name,
        "models": {v: {"name": c.name, "sha256": c.sha256} for v, c in models.items()},
        "alignment": config.alignment,
        "iterations": training.ppo.iterations,
        "episodes": config.evaluation.episodes,
    }
    threads = threads_of_each(config.workers, len(jobs), training.processes)
    with _logged(config, folder, track, task) as current:
        logged = _Logged(listener, folder, current)
        origin = _origin(setting, made_by, task, current)
        orders = Orders(config, folder, origin, until, threads)
        failed = train_all(orders, jobs, logged, logged.done)
        results = _tabulated(config, logged.judged, about)
        if results is not None:
            save(results, folder)
            logged.artifacts("results.json", "results.md")
        if failed and current is not None:
            current.flush()
            current.end("FAILED")
    return Outcome(results, current, failed)


def _models(setting: Setting, folder: Path) -> dict[Variant, Card]:
    """Bring what variants translate with, unless a run that began has it; see that it fits."""
    config, cards = setting.config, {}
    for variant, reference in _references(config).items():
        home = model_home(folder, variant)
        begun = (folder / CONFIG).exists() and home.exists()
        cards[variant] = verify(home) if begun else bring(reference, home, uri=config.tracking.uri)
        Registered(home / MODEL_FILE, cards[variant], setting.world(variant).spec)
    return cards


def _references(config: Finetune) -> dict[Variant, str]:
    """What names the models of the variants that translate."""
    named: dict[Variant, str | None] = {
        "translation": config.model, "stance": config.model, "diagnosed": config.diagnosed.model
    }  # fmt: skip
    used = {variant: named.get(variant) for variant in config.variants}
    return {variant: reference for variant, reference in used.items() if reference is not None}


@contextmanager
def _logged(config: Finetune, folder: Path, asked: bool, task: str) -> Iterator[Run | None]:
    """The run in MLflow, where it is asked for, has begun, or a model is of its registry."""
    models = _references(config).values() or [config.model]
    if not (asked or (folder / RUN_ID).exists() or not all(map(is_folder, models))):
        yield None
        return
    variants = ", ".join(f"`{v}`" for v in config.variants)
    note = (
        f"The walking policy of the task `{task}`, trained on {variants}, seeds "
        f"{', '.join(map(str, config.seeds))}, and judged in the real domain."
    )
    with tracked(config, folder) as current, machine(current):
        current.tags({"task": task, NOTE: note})
        yield current


def _origin(setting: Setting, made_by: str, task: str, current: Run | None) -> Origin:
    """What the policies' cards say of where they come from."""
    sources = {"start_policy": setting.base.card.sha256}
    if current is None:
        return Origin(made_by, task, sources=sources)
    run_path = f"{setting.config.tracking.experiment}/{current.id}"
    return Origin(made_by, task, run_path, sources)


def _tabulated(
    config: Finetune, judged: Mapping[Job, Judged], about: Mapping[str, object]
) -> dict[str, Any] | None:
    """The results of what was judged, in the order of the configuration."""
    done = [job for v in config.variants for job in jobs_of(config) if job.variant == v]
    done = [job for job in done if job in judged]
    variants: list[str] = [v for v in config.variants if any(job.variant == v for job in done)]
    of = {v: {job.seed: judged[job] for job in done if job.variant == v} for v in variants}
    if not of:
        return None
    figures = {v: {seed: one.figures for seed, one in by.items()} for v, by in of.items()}
    updates = {v: {seed: one.updates for seed, one in by.items()} for v, by in of.items()}
    return plain(figures, about, updates)


class _Logged:
    """Hands on what is said, and logs it to MLflow where the run is tracked.

    Attributes:
        judged: what came of the trainings that have ended.
    """

    def __init__(self, listener: Listener, folder: Path, current: Run | None) -> None:
        """Nothing is judged yet."""
        self.progress, self.warn = listener.progress, listener.warn
        self._folder, self._current = folder, current
        self.judged: dict[Job, Judged] = {}

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        """Log the figures of an update."""
        if self._current is not None:
            self._current.metrics({f"{what}/{key}": value for key, value in values.items()}, step)

    def done(self, job: Job, judged: Judged) -> None:
        """Keep what came of a training."""
        self.judged[job] = judged
        if self._current is None:
            return
        if job.variant != "none":
            self.artifacts(f"{job}/rollout.rrd")
        figures = {f"{job.variant}/{key}": value for key, value in vars(judged.figures).items()}
        self._current.metrics(figures, job.seed)

    def artifacts(self, *names: str) -> None:
        """Log files of the run's folder under the same names."""
        for name in map(Path, names):
            if self._current is not None:
                into = None if name.parent == Path() else str(name.parent)
                self._current.artifact(self._folder / name, into)
