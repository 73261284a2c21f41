"""A run's folder: claimed by one configuration, and its run in MLflow found again when resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

from wt.config import TrackingConfig
from wt.errors import ConfigError
from wt.run.track import Run, run
from wt.schema import flat, to_yaml
from wt.show.files import write_whole

CONFIG = "config.yaml"
RUN_ID = "mlflow_run_id"

T = TypeVar("T")


@runtime_checkable
class SideBySide(Protocol):
    """A configuration that says how much is done at once."""

    workers: int


@runtime_checkable
class Tracked(Protocol):
    """A configuration that says where its run is tracked."""

    tracking: TrackingConfig


def claim(config: T, folder: Path, load: Callable[[Path], T], resume: bool) -> T:
    """See that a folder may hold the run of a configuration; nothing is written.

    Args:
        config: the resolved configuration.
        folder: the run's folder, new or empty unless resumed.
        load: reads the configuration that is kept in it.
        resume: continue the run that is in it.

    Returns:
        The configuration that the run began with, if resumed, with as many workers as are given,
        which decide nothing; else the one given.

    Raises:
        ConfigError: it is a file, holds another run, or none to resume.
    """
    kept = folder / CONFIG
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"--out: {folder} is a file; name a folder, new or empty")
    if resume:
        if not kept.exists():
            raise ConfigError(f"--resume: {folder} holds no run ({CONFIG} is missing)")
        begun = load(kept)
        if isinstance(begun, SideBySide) and isinstance(config, SideBySide):
            begun.workers = config.workers
        if to_yaml(begun) != to_yaml(config):
            raise ConfigError(
                f"--resume: the configuration differs from {kept}, with which the run began; "
                f"resume with --config {kept} and no overrides, or choose a new --out"
            )
        return begun
    if kept.exists():
        raise ConfigError(f"{folder} already holds a run; add --resume, or choose a new --out")
    return config


def keep(config: object, folder: Path) -> None:
    """Write the configuration of a run into its folder, which is made if new."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / CONFIG, to_yaml(config))


@contextmanager
def tracked(config: Tracked, folder: Path) -> Iterator[Run]:
    """The run of a folder in MLflow, begun or continued, with its configuration logged.

    Args:
        config: of the run.
        folder: of the run; keeps the id, by which the run is found again.

    Raises:
        ConfigError: the store does not have the run that was begun, or with other parameters.
        WorkError: the store cannot be used.
    """
    kept, where = folder / RUN_ID, config.tracking
    run_id = kept.read_text().strip() if kept.exists() else None
    with run(where.experiment, folder.name, uri=where.uri, run_id=run_id) as current:
        write_whole(kept, current.id)
        current.params(flat(config))
        current.text(to_yaml(config), CONFIG)
        yield current
