"""A run in MLflow: parameters, metrics, tables, figures, files, and the code that made them.

::

    with track.run("r5_force", "all methods") as run:
        run.inputs([Dataset("r5_force/real", "training", digest, folder, 8000, columns)])
        child = run.child("DirectPred, seed 0")
        child.params({"lr": 3e-4})
        child.metrics({"loss/cycle": 0.1}, step=10)

The store is the registry's (``registry.backend``): ``MLFLOW_TRACKING_URI`` or ``./mlflow.db``.
MLflow is imported when a run begins, not before. Metrics are buffered: writing a thousand at
once costs about 0.1 s, writing them one by one 5 s.
"""

from __future__ import annotations

import getpass
import json
import math
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, SupportsFloat

from registry.backend import NOTE as NOTE
from registry.backend import ORIGIN, answering, artifact_location, connect, quiet, resolve_uri
from wt.errors import ConfigError, WorkError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mlflow import MlflowClient
    from mlflow.entities import Metric

UNKNOWN = "unknown"
_BATCH = 1000  # what MLflow takes in one call; 100 for parameters
_PARAMS = 100
_INHERITED = ("commit", "task", "paper.row", *ORIGIN)
_SECONDS = 10.0  # a metric is seen in the UI at most this long after it was logged


@dataclass(frozen=True)
class Source:
    """The code that is running.

    Attributes:
        commit: its git commit, ``"unknown"`` outside git.
        diff: changes since that commit, as a patch; untracked files are not in it.
    """

    commit: str
    diff: str


def source() -> Source:
    """Commit and uncommitted changes of this package; works outside git and without it."""
    file = Path(__file__)
    # A package installed into somebody else's repository is not that repository's commit.
    if _git(file.parent, "ls-files", "--error-unmatch", file.name) is None:
        return Source(UNKNOWN, "")
    commit = _git(file.parent, "rev-parse", "--verify", "HEAD")
    if commit is None:
        return Source(UNKNOWN, "")
    diff = _git(file.parent, "diff", "HEAD", "--no-color", "--no-ext-diff", "--", ":/")
    return Source(commit.strip(), diff or "")


@dataclass(frozen=True)
class Dataset:
    """Data that a run has used.

    Attributes:
        name: as shown.
        context: what it was used for: ``training``, ``validation`` or ``test``.
        digest: hash of its content, at most 36 characters.
        folder: where it lies.
        rows: number of transitions.
        columns: names of what the digest is of.
    """

    name: str
    context: str
    digest: str
    folder: Path
    rows: int
    columns: tuple[str, ...] = ()


@contextmanager
def run(
    experiment: str, name: str, *, uri: str | None = None, run_id: str | None = None
) -> Iterator[Run]:
    """A run that ends FINISHED, KILLED by Ctrl-C, or FAILED by any other exception.

    Args:
        experiment: experiment it belongs to, made if new.
        name: of the run in the UI.
        uri: the store; None for the default one.
        run_id: continue this run instead of beginning one.

    Raises:
        ConfigError: ``run_id`` is not in the store.
        WorkError: the store cannot be used.
    """
    uri = resolve_uri(uri)
    client = connect(uri, create=True)
    with answering(uri):
        current = _begin(client, uri, experiment, name) if run_id is None else None
    current = current or _resume(client, uri, str(run_id))
    try:
        yield current
        current.flush()
    except BaseException as error:
        status = "KILLED" if isinstance(error, KeyboardInterrupt) else "FAILED"
        with suppress(WorkError):  # what ended the run matters more
            current.flush()
        with suppress(WorkError):
            current.end(status)
        raise
    current.end("FINISHED")


class Run:
    """One run; made by :func:`run`.

    Attributes:
        id: its id in MLflow, to register models of it and to resume it.
        uri: the store.
    """

    def __init__(self, client: MlflowClient, uri: str, run_id: str, ended: bool = False) -> None:
        """Wrap a run that is there."""
        self.id = run_id
        self.uri = uri
        self._client = client
        self._pending: list[Metric] = []
        self._flushed = time.monotonic()
        self._children: dict[str, Run] = {}
        self._ended = ended

    @property
    def children(self) -> frozenset[str]:
        """Names of the runs below this one that were asked for."""
        return frozenset(self._children)

    def child(self, name: str) -> Run:
        """The run below this one that has a name: begun, or found again.

        It ends with this one, if it has not ended before.
        """
        if name not in self._children:
            with answering(self.uri):
                self._children[name] = _child(self._client, self.uri, self.id, name)
        return self._children[name]

    def tags(self, values: Mapping[str, str]) -> None:
        """Set tags; ``NOTE`` is the description that a person reads."""
        with answering(self.uri):
            for key, value in values.items():
                self._client.set_tag(self.id, key, value)

    def inputs(self, used: Sequence[Dataset]) -> None:
        """Say which data the run uses; the same again changes nothing."""
        from mlflow.entities import Dataset as Entity
        from mlflow.entities import DatasetInput, InputTag

        datasets = []
        for data in used:
            source = json.dumps({"uri": data.folder.absolute().as_uri()})
            profile = json.dumps({"num_rows": data.rows})
            columns = [{"type": "float", "name": n, "required": True} for n in data.columns]
            schema = json.dumps({"mlflow_colspec": columns}) if columns else None
            entity = Entity(data.name, data.digest, "local", source, schema, profile)
            datasets.append(DatasetInput(entity, [InputTag("mlflow.data.context", data.context)]))
        with answering(self.uri):
            self._client.log_inputs(self.id, datasets)

    def params(self, values: Mapping[str, object]) -> None:
        """Log parameters, flat names such as ``"train.lr"``.

        Raises:
            ConfigError: a resumed run was begun with another value.
        """
        from mlflow.entities import Param

        with answering(self.uri):
            known = self._client.get_run(self.id).data.params
            for key, value in values.items():
                if known.get(key, str(value)) != str(value):
                    raise ConfigError(
                        f"{key} is {value} now and was {known[key]} when run {self.id} began; "
                        "resume with the same configuration, or begin a new run"
                    )
            new = [Param(k, str(v)) for k, v in values.items() if k not in known]
            for start in range(0, len(new), _PARAMS):
                self._client.log_batch(self.id, params=new[start : start + _PARAMS])

    def metrics(self, values: Mapping[str, SupportsFloat], step: int) -> None:
        """Log metrics of one step; written when many have gathered or after some seconds."""
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        self._pending += [Metric(key, float(v), now, step) for key, v in values.items()]
        if len(self._pending) >= _BATCH or time.monotonic() - self._flushed > _SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the metrics that are still pending.

        Raises:
            WorkError: the store cannot be used.
        """
        for child in self._children.values():
            child.flush()
        with answering(self.uri):
            while self._pending:
                self._client.log_batch(self.id, metrics=self._pending[:_BATCH])
                del self._pending[:_BATCH]
        self._flushed = time.monotonic()

    def table(self, name: str, rows: Sequence[Mapping[str, object]]) -> None:
        """Log a table as ``<name>.json``, in the form MLflow's UI shows as one.

        Args:
            name: path among the artifacts, without suffix.
            rows: one mapping per row; a missing or non-finite value is an empty cell.
        """
        columns = list(dict.fromkeys(key for row in rows for key in row))
        data = [[_plain(row.get(column)) for column in columns] for row in rows]
        path = f"{name}.json"
        # Not MLflow's log_table: it appends to what an interrupted run has left.
        self.text(json.dumps({"columns": columns, "data": data}), path)
        with answering(self.uri):
            tags = self._client.get_run(self.id).data.tags
            shown = json.loads(tags.get("mlflow.loggedArtifacts", "[]"))
            entry = {"path": path, "type": "table"}
            if entry not in shown:
                shown = json.dumps([*shown, entry])
                self._client.set_tag(self.id, "mlflow.loggedArtifacts", shown)

    def figure(self, figure: Figure, path: str) -> None:
        """Log a matplotlib figure; the suffix of ``path`` decides its format."""
        with answering(self.uri):
            self._client.log_figure(self.id, figure, path)

    def text(self, text: str, path: str) -> None:
        """Log a text file, e.g. the resolved configuration as ``"config.yaml"``."""
        with answering(self.uri):
            self._client.log_text(self.id, text, path)

    def artifact(self, path: Path, folder: str | None = None) -> None:
        """Log a file, into ``folder`` among the artifacts or at their top."""
        with answering(self.uri):
            self._client.log_artifact(self.id, str(path), folder)

    def end(self, status: str) -> None:
        """Set MLflow's status of the run and those below it: FINISHED, FAILED or KILLED.

        A run that has ended keeps its status and its duration, whatever is logged to it later.
        """
        for child in self._children.values():
            child.end(status)
        if not self._ended:
            with answering(self.uri):
                self._client.set_terminated(self.id, status)
            self._ended = True


def _begin(client: MlflowClient, uri: str, experiment: str, name: str) -> Run:
    known = client.get_experiment_by_name(experiment)
    experiment_id = (
        client.create_experiment(experiment, artifact_location(uri, experiment))
        if known is None
        else known.experiment_id
    )
    code = source()
    # those of MLflow's own are the ones that its UI shows
    tags = {
        "commit": code.commit,
        "mlflow.source.git.commit": code.commit,
        "mlflow.source.name": Path(sys.argv[0]).name or "python",
        "mlflow.source.type": "LOCAL",
        "mlflow.user": _user(),
    }
    made = client.create_run(experiment_id, tags=tags, run_name=name)
    current = Run(client, uri, made.info.run_id)
    if code.diff:
        current.text(code.diff, "diff.patch")
    return current


def _resume(client: MlflowClient, uri: str, run_id: str) -> Run:
    from mlflow.exceptions import MlflowException

    try:
        client.get_run(run_id)
    except MlflowException as error:
        raise ConfigError(
            f"run {run_id!r} is not in {uri}; resume where it began, or begin a new run"
        ) from error
    with answering(uri):
        client.update_run(run_id, status="RUNNING")
    return Run(client, uri, run_id)


def _child(client: MlflowClient, uri: str, parent: str, name: str) -> Run:
    of = client.get_run(parent)
    known = client.search_runs(
        [of.info.experiment_id], f"tags.`mlflow.parentRunId` = '{parent}'", max_results=10_000
    )
    same = next((r for r in known if r.info.run_name == name), None)
    if same is not None:
        ended = same.info.status == "FINISHED"
        if not ended:
            client.update_run(same.info.run_id, status="RUNNING")
        return Run(client, uri, same.info.run_id, ended)
    shown = {k: v for k, v in of.data.tags.items() if k in _INHERITED}
    tags = {**shown, "mlflow.parentRunId": parent}
    made = client.create_run(of.info.experiment_id, tags=tags, run_name=name)
    return Run(client, uri, made.info.run_id)


@contextmanager
def machine(current: Run) -> Iterator[None]:
    """Log the machine's load (``system/…``) while a run goes on: processors, memory, disk, GPU.

    Every ten seconds, and at the end, so that a short run has it too.
    """
    from mlflow.exceptions import MlflowException
    from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

    with quiet():
        monitor = SystemMetricsMonitor(current.id, resume_logging=True, tracking_uri=current.uri)
        monitor.start()
    try:
        yield
    finally:
        with quiet(), suppress(MlflowException):  # what ended the run matters more
            monitor.finish()
            monitor.collect_metrics()
            monitor.publish_metrics(monitor.aggregate_metrics())
            monitor.mlflow_logger.flush()


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a container's user without a name
        return UNKNOWN


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=folder, capture_output=True, check=True, timeout=30
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.decode(errors="replace")


def _plain(value: object) -> object:
    if hasattr(value, "item"):  # a numpy or torch scalar
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
