"""The MLflow store that runs and models share: which one it is, and reaching it.

It is ``MLFLOW_TRACKING_URI`` if that is set (a server, or any other that MLflow knows), else
``mlflow.db``, a sqlite file in the current folder, where ``mlflow ui`` looks too. Artifacts of a
sqlite store lie beside it in ``mlartifacts``; a server keeps its own. MLflow, which takes seconds
to import, is imported when a store is reached and not before.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from wt.errors import RegistryError, WorkError, one_line

if TYPE_CHECKING:
    from mlflow import MlflowClient

URI_VARIABLE = "MLFLOW_TRACKING_URI"
DEFAULT_URI = "sqlite:///mlflow.db"
PROBE_SECONDS = 5.0

NOTE = "mlflow.note.content"
"""Tag with the description that a person reads."""
ORIGIN = ("mlflow.source.git.commit", "mlflow.source.name", "mlflow.source.type", "mlflow.user")
"""Tags by which MLflow's pages show what code made a run or a model, and who started it."""
KEPT = ("paper.row", *ORIGIN)
"""Tags of a run that the model it made has, too."""

_SQLITE = "sqlite:///"
_BARS = "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR"


def resolve_uri(uri: str | None = None) -> str:
    """The store's URI: the given one, else ``MLFLOW_TRACKING_URI``, else the default.

    A relative sqlite path is made absolute, since it would mean another file after a ``chdir``.
    """
    uri = uri or os.environ.get(URI_VARIABLE) or DEFAULT_URI
    path = _sqlite_path(uri)
    return uri if path is None else f"{_SQLITE}{path.absolute()}"


def artifact_location(uri: str, experiment: str) -> str | None:
    """Place of a new experiment's artifacts: beside a sqlite file; None lets the server decide."""
    path = _sqlite_path(uri)
    return None if path is None else str(path.parent / "mlartifacts" / experiment)


def connect(uri: str, *, create: bool) -> MlflowClient:
    """A client of the store at ``uri`` (see :func:`resolve_uri`), ready to answer.

    Args:
        uri: the store.
        create: make a new sqlite store if there is none.

    Raises:
        RegistryError: there is no store and none shall be made.
        WorkError: the server does not answer, or the sqlite file cannot be opened.
    """
    path = _sqlite_path(uri)
    if path is not None:
        if not create and not path.exists():
            raise RegistryError(
                f"no model store at {path}; 'wt fit' makes one, or set {URI_VARIABLE} to yours"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
    elif uri.startswith(("http://", "https://")):
        _probe(uri)
    with answering(uri), quiet():
        from mlflow import MlflowClient

        client = MlflowClient(tracking_uri=uri)
        client.search_experiments(max_results=1)  # opens a sqlite file, and fills a new one
    return client


@contextmanager
def answering(uri: str) -> Iterator[None]:
    """Turn what MLflow raises about the store at ``uri`` into one line.

    Raises:
        WorkError: MLflow, its database or the connection failed.
    """
    from mlflow.exceptions import MlflowException
    from requests import RequestException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError, RequestException) as error:
        raise WorkError(
            f"the MLflow store {uri} failed ({one_line(error)}); check it, or name another "
            f"in {URI_VARIABLE}"
        ) from error


@contextmanager
def chosen(uri: str) -> Iterator[None]:
    """Let ``uri`` be the store of MLflow's own code where that takes no argument for it."""
    from mlflow.tracking._tracking_service.utils import _use_tracking_uri

    said = os.environ.get(URI_VARIABLE)
    try:
        with _use_tracking_uri(uri):
            yield
    finally:
        # MLflow sets the variable too, and in the end removes it, whoever had set it before
        os.environ.pop(URI_VARIABLE, None)
        if said is not None:
            os.environ[URI_VARIABLE] = said


@contextmanager
def quiet() -> Iterator[None]:
    """Hide MLflow's notes about database tables and its bars, one for every small file."""
    logger, level = logging.getLogger("mlflow"), logging.getLogger("mlflow").level
    bars = os.environ.get(_BARS)
    logger.setLevel(logging.WARNING)
    os.environ[_BARS] = "false"  # MLflow reads it at each download and takes no argument for it
    try:
        yield
    finally:
        logger.setLevel(level)
        os.environ.pop(_BARS)
        if bars is not None:
            os.environ[_BARS] = bars


def _sqlite_path(uri: str) -> Path | None:
    return Path(uri[len(_SQLITE) :].partition("?")[0]) if uri.startswith(_SQLITE) else None


def _probe(uri: str) -> None:
    """Ask a server once: MLflow itself would try for minutes before it gives up."""
    import requests

    try:
        requests.get(f"{uri.rstrip('/')}/health", timeout=PROBE_SECONDS)
    except requests.RequestException as error:
        raise WorkError(
            f"no MLflow server answers at {uri} ({type(error).__name__}); start it, or unset "
            f"{URI_VARIABLE} to use {DEFAULT_URI}"
        ) from error
