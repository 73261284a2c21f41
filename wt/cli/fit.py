"""``wt fit``: the main job."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wt.cli._extras import need
from wt.errors import WorkError

if TYPE_CHECKING:
    from wt.config import FitConfig
    from wt.joined import Joined
    from wt.run.study import Listener

NEEDED = ("omegaconf", "torch", "lightning", "mlflow", "rerun", "onnxscript", "matplotlib")
"""What configures, trains, tracks, shows and exports: the last would be missed after hours."""


def command(
    config: Annotated[
        Path,
        typer.Option(help="YAML file of the task, or a shipped name, as r5."),
    ],
    overrides: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Override what it says.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the run; runs/<task>-<time> by default.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL", help="Simulate with this MJCF, or with that of a diagnosis' folder."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the interrupted run in --out.")
    ] = False,
) -> None:
    """Train World Translation on a task, compare it with its baselines, register the model.

    Collects transitions of both domains (or reuses those it has), trains, evaluates on pairs that
    were never trained on, logs to MLflow, records rollouts for Rerun, exports to ONNX, registers
    the model, and prints the table of results. With a section "diagnose", also diagnoses R's
    recordings, does it all again on the patched simulator, and compares.

    Example:
        wt fit --config r5 seeds=[0,1,2]
        wt fit --config go2_concealed
        wt fit --config go2_flat --model diagnosis/
    """
    from rich.console import Console

    need(*NEEDED)
    from wt.cli._progress import bars
    from wt.errors import ConfigError
    from wt.fit import fit, open_folder
    from wt.show.files import kept

    if resume and out is None:
        raise ConfigError("--resume needs --out: the folder of the run to continue")
    settings = _settings(config, overrides or [], model)
    folder = out or Path("runs") / f"{settings.task}-{datetime.now():%Y-%m-%dT%H-%M-%S}"
    with kept(folder):
        settings = open_folder(settings, folder, resume)
        try:
            with bars() as listener:
                done, tracked = fit(settings, folder, listener)
                both = _joined(settings, folder, listener) if settings.diagnose else None
        except KeyboardInterrupt as error:
            raise _interrupted(folder) from error
    console = Console()
    done.results.print_table(console)
    console.print(f"{done.version}: {done.version.decision}")
    if both is not None:
        both.print_table(console)
    console.print(f"run {tracked.id} in {tracked.uri}; files in {folder}", soft_wrap=True)


def _settings(config: Path, overrides: list[str], model: Path | None) -> FitConfig:
    from wt.config import load
    from wt.fit import on_model

    settings = load(config, overrides)
    return settings if model is None else on_model(settings, model)


def _joined(settings: FitConfig, folder: Path, listener: Listener) -> Joined:
    from wt.joined import join  # with all of wt diagnose, which few runs need

    return join(settings, folder, listener)


def _interrupted(folder: Path) -> WorkError:
    from wt.run.folder import CONFIG

    return WorkError(
        "interrupted: nothing finished is lost; continue with: "
        f"wt fit --config {folder / CONFIG} --resume --out {folder}"
    )
