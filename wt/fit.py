"""The main job, which ``wt fit`` runs: collect, train, compare, export, register.

A run's folder holds the resolved configuration, the results, the exported model with its card,
the Rerun recording and, under ``work/``, what an interrupted run continues from: checkpoints and
the predictions of every method that is already finished.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields, replace
from pathlib import Path

from wt.baselines.base import find, longest_first
from wt.config import FitConfig, load
from wt.errors import ConfigError
from wt.evaluate import paper
from wt.evaluate.results import OURS, PAPERS_OWN
from wt.evaluate.single_step import Errors, errors
from wt.run.folder import claim, keep, tracked
from wt.run.jobs import Job, run_jobs
from wt.run.publish import Published, check_name, publish
from wt.run.study import Listener, Study, check
from wt.run.track import NOTE, Dataset, Run, machine
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
    with tracked(config, folder) as current, machine(current), ExitStack() as stack:
        current.tags(_tags(config))
        methods = [OURS, PAPERS_OWN, *longest_first(config.baselines.names)]
        jobs = [Job(seed, method) for seed in config.seeds for method in methods]
        logged = _Logged(listener, current, config, jobs, stack)
        study = Study.open(config, folder, logged)
        _announce_streams(study, listener)
        logged.collections = _datasets(study)
        current.inputs(list(logged.collections.values()))
        run_jobs(study, jobs)
        by_seed = {seed: _evaluate(study, seed, logged) for seed in config.seeds}
        return publish(study, by_seed, current), current


class _Logged:
    """Hands progress and warnings on, and metrics to the run of their method and seed in MLflow.

    Such a run lasts as long as its job makes progress, and has the machine's load meanwhile.

    Attributes:
        collections: the data of the run; each job's run lists what that job uses of them.
    """

    def __init__(
        self,
        listener: Listener,
        tracked: Run,
        config: FitConfig,
        jobs: Sequence[Job],
        stack: ExitStack,
    ) -> None:
        self.warn, self._progress, self.tracked = listener.warn, listener.progress, tracked
        self._config, self._jobs = config, {str(job): job for job in jobs}
        self._stack, self._watched = stack, dict[str, ExitStack]()
        self.collections: dict[str, Dataset] = {}

    def child(self, what: str) -> Run:
        """The run of a job, begun when it is first asked for."""
        begun = what in self.tracked.children
        child = self.tracked.child(what)
        if not begun:
            job = self._jobs[what]
            child.params(job.parameters(self._config))
            there, uses = self.collections, job.uses(self._config).items()
            child.inputs([replace(there[of], context=use) for of, use in uses if of in there])
            child.tags({NOTE: _note(job, self._config.task)})
        return child

    def progress(self, what: str, done: int, total: int) -> None:
        self._progress(what, done, total)
        if what not in self._jobs:
            return
        if what not in self._watched:
            self._watched[what] = self._stack.enter_context(ExitStack())
            self._watched[what].enter_context(machine(self.child(what)))
        if done >= total:
            self._watched[what].close()
            self.finish(what)

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        self.child(what).metrics(values, step)

    def finish(self, what: str) -> None:
        """Say that a job has ended."""
        child = self.child(what)
        child.flush()
        child.end("FINISHED")


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
    return {"task": config.task, "paper.row": row or "none", NOTE: note}


def _note(job: Job, task: str) -> str:
    """What a person reads of the run of one method and seed."""
    if job.method in (OURS, PAPERS_OWN):
        whose = "ours" if job.method == OURS else "the paper's, unchanged"
        what = f"World Translation, {whose}"
    else:
        what = (inspect.getdoc(find(job.method)) or "").split("\n\n")[0].rstrip(".")
    return (
        f"`{job.method}` on the task `{task}`, seed {job.seed}: {' '.join(what.split())}. "
        "`test/mse` is its error on pairs that neither trained nor chose, `val/…`, where Algorithm "
        "1 or a regression ran, its error on what is held out meanwhile."
    )


def _announce_streams(study: Study, listener: Listener) -> None:
    """Say what is more than memory is to hold, and what is done about it."""
    streams = study.data.streams
    for domain, stored in (("S", streams.sim), ("R", streams.real)):
        if stored is not None:
            listener.warn(
                f"{len(stored)} transitions of {domain} are more than data.in_memory "
                f"{streams.in_memory}: Algorithm 1 and mean fields stream them; normalisers and "
                f"baselines are fitted to {streams.in_memory} at most, evenly spread over them"
            )


def _datasets(study: Study) -> dict[str, Dataset]:
    """The collections by their names there, as MLflow lists them."""
    collected, task, spec = study.data, study.config.task, study.world.spec
    channels = {"o": spec.observation, "a": spec.action, "s_next": spec.state}
    columns = tuple(f"{of}/{c.name}" for of, each in channels.items() for c in each)
    uses = {"validation": "validation", "test": "test"}
    uses = dict.fromkeys(("sim", "real", "lessons"), "training") | uses
    return {
        what: Dataset(
            f"{task}/{what}",
            use,
            collected.digest(what),
            collected.folders[what],
            len(collected.whole(what)),
            columns,
        )
        for what, use in uses.items()
        if what in collected.folders
    }


def _evaluate(study: Study, seed: int, logged: _Logged) -> dict[str, Errors]:
    """Errors of every method with one seed; the first and only look at the test pairs."""
    by_method = {}
    for method in (*study.config.baselines.names, PAPERS_OWN, OURS):
        by_method[method] = errors(study.prediction(seed, method), study.data.test, study.scales)
        values = {"mse": by_method[method].mse, "mse_change": by_method[method].mse_change}
        logged.tracked.metrics({f"test/{k}/{method}": v for k, v in values.items()}, seed)
        of_method = {f"test/{k}": v for k, v in values.items()}
        logged.metrics(str(Job(seed, method)), of_method, 0)
        logged.finish(str(Job(seed, method)))  # of those that learn nothing nobody has said so
    return by_method
