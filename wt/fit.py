"""The main job, which ``wt fit`` runs: collect, train, compare, export, register.

A run's folder holds the resolved configuration, the results, the exported model with its card,
the Rerun recording and, under ``work/``, what an interrupted run continues from: checkpoints and
the predictions of every method that is already finished.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path

from wt.baselines.base import longest_first
from wt.config import FitConfig, load
from wt.data.transitions import content_hash
from wt.errors import ConfigError
from wt.evaluate import paper
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.evaluate.single_step import Errors, errors
from wt.run.folder import claim, keep, tracked
from wt.run.jobs import Job, run_jobs
from wt.run.publish import Published, check_name, publish
from wt.run.study import Listener, Study, check
from wt.run.track import Dataset, Run, machine
from wt.worlds.base import kind_of


def on_model(config: FitConfig, model: Path) -> FitConfig:
    """A configuration whose simulator is an MJCF from a file: the one that a diagnosis patched.

    Args:
        config: of a task whose world takes one, as ``world.model``.
        model: the MJCF, or the folder of a diagnosis.

    Raises:
        ConfigError: the task's simulator is not to be replaced.
    """
    name = config.world.get("name", "")
    if "model" not in {f.name for f in fields(kind_of(config.world).options)}:
        raise ConfigError(
            f"--model: the world '{name}' has no option world.model, its simulator is built in; "
            "worlds of walking robots and the SO-101 take one"
        )
    return replace(config, world={**config.world, "model": str(model)})


def open_folder(config: FitConfig, folder: Path, resume: bool) -> FitConfig:
    """Claim a run's folder and keep the configuration in it.

    Args:
        config: the resolved configuration.
        folder: the run's folder, new or empty unless resumed.
        resume: continue the run that is in it, with the configuration that it began with.

    Raises:
        ConfigError: the folder holds another run, or none to resume, or is a file; the
            configuration cannot be run.
    """
    config = claim(config, folder, load, resume)
    if not resume:
        check(config)
        check_name(config)
        keep(config, folder)
    return config


def fit(config: FitConfig, folder: Path, listener: Listener) -> tuple[Published, Run]:
    """Run everything; finished parts found in ``folder`` are not run again.

    Args:
        config: the resolved configuration, already in ``folder``.
        folder: the run's folder.
        listener: told of progress and warnings.

    Returns:
        What was published, and the MLflow run.
    """
    with tracked(config, folder) as current, machine(current):
        current.tags(_tags(config))
        study = Study.open(config, folder, _Logged(listener, current))
        _announce_streams(study, listener)
        current.inputs(_datasets(study))
        methods = [OURS, PAPERS_OWN, *longest_first(config.baselines.names)]
        jobs = [Job(seed, method) for seed in config.seeds for method in methods]
        for job in jobs:
            current.child(str(job)).params(job.parameters(config))
        run_jobs(study, jobs)
        by_seed = {seed: _evaluate(study, seed, current) for seed in config.seeds}
        return publish(study, by_seed, current), current


class _Logged:
    """Hands progress and warnings on, and metrics to the run of their method and seed in MLflow."""

    def __init__(self, listener: Listener, tracked: Run) -> None:
        self.progress, self.warn, self._tracked = listener.progress, listener.warn, tracked

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        self._tracked.child(what).metrics(values, step)


def _tags(config: FitConfig) -> dict[str, str]:
    """What a person reads of a run in MLflow, and finds it by."""
    row = paper.row(config.task)
    row_text = f" It stands beside the paper's {row}." if row else ""
    methods = ", ".join([OURS, PAPERS_OWN, *config.baselines.names])
    note = (
        f"Single-step prediction on the task `{config.task}`: {methods}, each with seeds "
        f"{config.seeds}, one run below this one each.{row_text} `single_step.json` among the "
        "artifacts is the table, `rollout.rrd` is for `wt view`."
    )
    return {"task": config.task, "paper.row": row or "none", "mlflow.note.content": note}


def _announce_streams(study: Study, listener: Listener) -> None:
    """Say what is more than memory is to hold, and what is done about it."""
    streams = study.data.streams
    for domain, stored in (("S", streams.sim), ("R", streams.real)):
        if stored is not None:
            listener.warn(
                f"{len(stored)} transitions of {domain} are more than data.in_memory "
                f"{streams.in_memory}: Algorithm 1 streams them, and normalisers, mean field and "
                f"baselines are fitted to {streams.in_memory} at most, evenly spread over them"
            )


def _datasets(study: Study) -> list[Dataset]:
    """The collections, as MLflow lists them."""
    collected, task = study.data, study.config.task
    uses = {"sim": "training", "real": "training", "validation": "validation", "test": "test"}
    return [
        Dataset(
            f"{task}/{what}",
            use,
            content_hash(getattr(collected, what)),
            collected.folders[what],
            len(collected.whole(what)),
        )
        for what, use in uses.items()
        if what in collected.folders
    ]


def _evaluate(study: Study, seed: int, tracked: Run) -> dict[str, Errors]:
    """Errors of every method with one seed; the first and only look at the test pairs."""
    by_method = {}
    for method in (*study.config.baselines.names, PAPERS_OWN, OURS):
        by_method[method] = errors(study.prediction(seed, method), study.data.test, study.scales)
        values = {"mse": by_method[method].mse, "mse_change": by_method[method].mse_change}
        tracked.metrics({f"test/{method}/{k}": v for k, v in values.items()}, seed)
        of_method = {f"test/{k}": v for k, v in values.items()}
        tracked.child(str(Job(seed, method))).metrics(of_method, 0)
    return by_method
