"""The steps of ``wt-train-policy``: train, export, evaluate, calibrate, put in place."""

from __future__ import annotations

import functools
import hashlib
import importlib
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from wt.errors import WorkError, lacking
from wt.locomotion.config import PolicyConfig
from wt.show.files import write_together
from wt.worlds.policy import CARD, GRAPH, SHIPPED, Policy, folder_of

if TYPE_CHECKING:
    from wt.locomotion.evaluate import PolicyEvaluation
    from wt.locomotion.train import Begin

Show = Callable[[str, float], None]
"""Told what is being done and which share of it is behind."""


def run(
    config: PolicyConfig,
    folder: Path,
    *,
    made_by: str,
    show: Show | None = None,
    resume: bool = False,
    start_from: Path | None = None,
    seconds: float | None = None,
    install: bool = False,
    watch: bool = False,
) -> str:
    """Train a policy and leave it in ``folder``; the rest is as :func:`wt.locomotion.train.train`.

    Args:
        config: what is trained.
        folder: of the training.
        made_by: the command line, for the card.
        show: called with the present step and the share of the training that is done.
        resume: continue from the folder's checkpoint.
        start_from: ``.pt`` of another training, or a policy: its folder, or name in the package.
        seconds: wall clock of the training [s].
        install: also write the policy into the package.
        watch: also write a recording for Rerun.

    Returns:
        The table of its figures.

    Raises:
        WorkError: rsl_rl is not installed.
        ConfigError: as :func:`wt.locomotion.train.train` says.
        ModelError: ``start_from`` is no policy of this robot.
    """
    find_rsl_rl()
    from wt.locomotion import export
    from wt.locomotion.evaluate import table
    from wt.locomotion.train import CHECKPOINT, train

    begin = _beginning(config, start_from)
    sources = _sources(folder / CHECKPOINT if resume else start_from)
    origin = export.Origin(made_by, config.name, sources=sources)
    progress = functools.partial(_tell, show)
    trained = train(
        config, folder, resume=resume, start_from=begin, seconds=seconds, progress=progress
    )
    export.write(trained, config, folder, origin)
    if show:
        show("evaluating", 1.0)
    policy, figures = _calibrated(config, folder)
    export.judged(folder, figures)
    if install:
        _install(folder, config.name)
    if watch:
        from wt.locomotion.watch import record

        record(config, policy.act, folder / "rollout.rrd")
    return table(figures)


def _tell(show: Show | None, done: int, total: int, row: Mapping[str, float]) -> None:
    """Say how a training goes on: beside a bar, and in lines where nobody sees one."""
    from wt.locomotion.train import line

    if show:
        show(f"reward {row['reward']:.2f} falls {row['falls']:.1f}", done / total)
    if not sys.stderr.isatty():
        print(line(done, total, row), flush=True)


def _install(folder: Path, name: str) -> None:
    files = {part: (folder / part).read_bytes() for part in (GRAPH, CARD)}
    (SHIPPED / name).mkdir(parents=True, exist_ok=True)
    write_together(SHIPPED / name, files)


def _beginning(config: PolicyConfig, path: Path | None) -> Path | Begin | None:
    """What fills new nets, as :func:`wt.locomotion.train.train` takes it."""
    from wt.locomotion.start import of_other_drives, take_over

    if path is None or path.suffix == ".pt":
        return path
    policy = of_other_drives(path, config.body())
    return functools.partial(take_over, policy=policy, path=str(path), warm_up=config.ppo.warm_up)


def _sources(began_with: Path | None) -> dict[str, str]:
    """The hash of what a training begins with, if with anything, as on the card.

    Of what is not there nothing is said: the training itself refuses it.
    """
    if began_with is None:
        return {}
    if began_with.suffix == ".pt":
        return {"checkpoint": _sha256(began_with)} if began_with.is_file() else {}
    return {"start_policy": _sha256(folder_of(began_with) / GRAPH)}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _calibrated(config: PolicyConfig, folder: Path) -> tuple[Policy, PolicyEvaluation]:
    """The policy in a folder and its figures, once its commands are scaled to what it reaches."""
    from wt.locomotion.calibrate import calibrate, factors
    from wt.locomotion.evaluate import evaluate

    def judged() -> tuple[Policy, PolicyEvaluation]:
        policy = Policy.load(folder, config.body(), config.physics)
        threads = config.threads * config.processes
        return policy, evaluate(config, policy.act, threads=threads)

    policy, figures = judged()
    by = factors(figures)
    if (by == 1.0).all():
        return policy, figures
    calibrate(folder, by)
    return judged()


def find_rsl_rl() -> None:
    """Find out whether policies can be trained here.

    Raises:
        WorkError: rsl_rl is not installed.
    """
    # it imports GitPython, which refuses to be imported where there is no git
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    try:
        importlib.import_module("rsl_rl.runners")
    except ModuleNotFoundError as error:
        raise WorkError(lacking("training", error.name, "rl")) from error
