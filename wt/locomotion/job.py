"""The steps of ``wt-train-policy``: train, export, evaluate, calibrate, put in place."""

from __future__ import annotations

import functools
import importlib
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from wt.errors import WorkError, lacking
from wt.locomotion.config import PolicyConfig
from wt.show.files import write_together
from wt.worlds.policy import CARD, GRAPH, SHIPPED, Policy

if TYPE_CHECKING:
    from wt.locomotion.evaluate import PolicyEvaluation
    from wt.locomotion.train import Begin


def run(
    config: PolicyConfig,
    folder: Path,
    *,
    made_by: str,
    show: Callable[[str, float], None] | None = None,
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
    from wt.locomotion.train import line, train

    def progress(done: int, total: int, row: Mapping[str, float]) -> None:
        if show:
            show(f"reward {row['reward']:.2f} falls {row['falls']:.1f}", done / total)
        if not sys.stderr.isatty():
            print(line(done, total, row), flush=True)

    begin = _beginning(config, start_from)
    trained = train(
        config, folder, resume=resume, start_from=begin, seconds=seconds, progress=progress
    )
    export.write(trained, config, folder, made_by)
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
