"""The workbench of exhibits: runs of the paper's tasks, and models trained at most once.

Everything lies below the output folder, one run of ``wt fit`` per task. A variant of a method is
one more model of that run, kept under the hash of what was changed; whatever is finished is found
again, also by another exhibit and by another command with the same configuration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from wt.baselines.base import Baseline
from wt.config import FitConfig, load, to_yaml
from wt.data.transitions import digest
from wt.errors import WorkError
from wt.evaluate.representation import Features, features, whole_episodes
from wt.evaluate.results import OURS, PAPERS_OWN, Results
from wt.evaluate.single_step import Errors, errors
from wt.fit import fit, open_folder
from wt.nets.world_model import WorldModel
from wt.reproduce.tasks import PaperTask
from wt.run.folder import CONFIG
from wt.run.jobs import Job, run_jobs
from wt.run.study import Listener, Study
from wt.types import Transitions

FEATURES, FEATURES_QUICK = 20_000, 3000
"""Transitions of each domain that representations are looked at on."""


class Variant(NamedTuple):
    """The paper's method or ours, or one that differs from it by some settings.

    Attributes:
        name: as in tables.
        method: what it is a variant of.
        changes: ``key=value`` words on that method's settings.
    """

    name: str
    method: str = PAPERS_OWN
    changes: tuple[str, ...] = ()

    def job(self, seed: int) -> Job:
        """Its training with one seed."""
        return Job(seed, self.method, self.changes)


FULL = Variant("full")
"""The paper's method."""

BASIC = Variant("w/o", changes=("vae.classifier_weight=0", "nets.film=false"))
"""Without its auxiliary parts, domain classifier and FiLM (tables I and II)."""

PLUS = Variant(OURS, OURS)
"""Our best: S encodes what is hidden, and nothing is translated without pairs."""

MEAN_FIELD = Variant("mean field and translation", OURS, ("mean.kind=mode", "mean.simulator=base"))
"""Our classes with what nothing hidden decides apart, and a translation of what is left."""


@dataclass
class Bench:
    """Data and models for exhibits.

    Attributes:
        conf: folder of the configurations.
        out: folder of the report; the runs lie below it.
        tasks: the tasks that can be run.
        overrides: ``key=value`` words on top of every task's configuration.
        quick: whether everything is to be small.
        listener: told of progress and warnings.
    """

    conf: Path
    out: Path
    tasks: Sequence[PaperTask]
    overrides: Sequence[str]
    quick: bool
    listener: Listener
    _open: dict[str, Study] = field(default_factory=dict)
    _read: dict[tuple[str, ...], FitConfig] = field(default_factory=dict)
    _written: dict[str, str] = field(default_factory=dict)

    def task(self, name: str) -> PaperTask:
        """The task of that name, which can be run."""
        return next(task for task in self.tasks if task.name == name)

    def config(self, name: str, extra: Sequence[str] = ()) -> FitConfig:
        """A task's configuration."""
        key = (name, *extra)
        if key not in self._read:
            path = self.conf / self.task(name).config
            self._read[key] = load(path, [*self.overrides, *extra])
        return self._read[key]

    def identity(self, tasks: Sequence[str]) -> str:
        """Hash of what decides the numbers of an exhibit of these tasks."""
        there = [task.name for task in self.tasks if task.name in tasks]
        for name in there:
            if name not in self._written:  # every exhibit asks, and some ask twice
                self._written[name] = to_yaml(self.config(name))
        configs = {name: self._written[name] for name in there}
        return digest({"tasks": configs, "quick": self.quick})

    def results(self, task: PaperTask) -> Results:
        """Results of ``wt fit`` on a task: those that lie in its folder, or of its run."""
        folder = self.out / task.name
        begun = (folder / CONFIG).is_file()
        config = open_folder(self.config(task.name), folder, resume=begun)
        if not (folder / "results.json").is_file():
            fit(config, folder, self.listener)
        return Results.load(folder)

    def study(self, name: str, extra: Sequence[str] = (), label: str = "") -> Study:
        """A task's run with its data, begun or continued.

        Args:
            name: of the task.
            extra: overrides that make it another world.
            label: of that other world; its run lies in a folder of its own.
        """
        home = f"{name}-{label}" if label else name
        if home not in self._open:
            folder = self.out / home
            begun = (folder / CONFIG).is_file()
            config = open_folder(self.config(name, extra), folder, resume=begun)
            self._open.clear()  # one task's data at a time
            self._open[home] = Study.open(config, folder, self.listener)
        # the bars of the exhibit that first needed it are gone
        return replace(self._open[home], listener=self.listener)

    def train(
        self, study: Study, variants: Sequence[Variant], baselines: Sequence[str] = ()
    ) -> None:
        """Train whatever of these is not trained yet, with every seed."""
        jobs = [variant.job(seed) for seed in study.config.seeds for variant in variants]
        jobs += [Job(seed, name) for seed in study.config.seeds for name in baselines]
        run_jobs(study, jobs)

    def model(self, study: Study, variant: Variant, seed: int) -> WorldModel:
        """A trained model."""
        job = variant.job(seed)
        return study.load_model(seed, job.key, job.settings(study.config))

    def baseline(self, study: Study, name: str, seed: int) -> Baseline:
        """A trained baseline.

        Raises:
            WorkError: it was trained by a version that kept no weights.
        """
        baseline = study.load_baseline(seed, name)
        if baseline is None:
            raise WorkError(
                f"{study.home(seed, name)} holds no weights of {name}; delete "
                f"{study.home(seed, name)}.npy and run again, only this one is trained anew"
            )
        return baseline

    def errors(self, study: Study, variant: Variant, seed: int) -> Errors:
        """Single-step error of a trained model on the test pairs."""
        predicted = study.prediction(seed, variant.job(seed).key)
        return errors(predicted, study.data.test, study.scales)

    def looked_at(self, study: Study) -> tuple[Transitions, Transitions]:
        """The transitions of S and of R that representations are looked at on."""
        count = FEATURES_QUICK if self.quick else FEATURES
        return whole_episodes(study.data.sim, count), whole_episodes(study.data.real, count)

    def features(self, study: Study, variant: Variant, seed: int) -> tuple[Features, Features]:
        """Features that a trained model makes of these transitions."""
        return features(self.model(study, variant, seed), *self.looked_at(study))
