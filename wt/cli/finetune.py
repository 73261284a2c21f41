"""``wt-finetune``, which is ``wt finetune``: adapt a walking policy to translated dynamics."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from wt.finetune.job import Outcome

LimitOption = Annotated[
    float | None,
    typer.Option(
        metavar="MINUTES",
        min=0.01,
        help="Begin no further update after so long; what there is of each policy is exported and "
        "judged, which takes a while more. --resume goes on from there.",
    ),
]


def command(
    config: Annotated[Path, typer.Option(help="YAML file, or a shipped name, as finetune_go2.")],
    overrides: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Override what it says.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the run; runs/finetune-<time> by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the interrupted run in --out.")
    ] = False,
    time_limit: LimitOption = None,
    track: Annotated[
        bool, typer.Option("--track", help="Log to MLflow even if all models are of folders.")
    ] = False,
) -> None:
    """Fine-tune a walking policy on translated dynamics, beside its rivals, and judge all in R.

    The simulator's transitions are translated at every control step by a model of the registry, or
    from a folder; rsl_rl's PPO goes on from the base policy. Trains variants and seeds side by
    side. Prints tracking, stability and power of every variant in R on one sequence of commands,
    the paper's beside them. The folder of each variant holds policy.onnx, card.json, the checkpoint
    and a recording for Rerun.

    Example:
        wt-finetune --config finetune_go2 seeds=[0]
        wt-finetune --config finetune_go2 model=runs/go2_flat variants=[none,translation] workers=4
        wt finetune --config finetune_go2 --out runs/tuned --resume
    """
    from datetime import datetime

    from wt.cli._extras import need
    from wt.cli._progress import bars
    from wt.errors import ConfigError, WorkError

    need("rsl_rl")  # its extra brings all else
    from wt.finetune.config import load
    from wt.locomotion.job import find_rsl_rl

    find_rsl_rl()
    from wt.finetune.job import run
    from wt.run.folder import CONFIG, claim
    from wt.show.files import kept

    if resume and out is None:
        raise ConfigError("--resume needs --out: the folder of the run to continue")
    folder = out or Path("runs") / f"finetune-{datetime.now():%Y-%m-%dT%H-%M-%S}"
    again = f"continue with: wt-finetune --config {folder / CONFIG} --resume --out {folder}"
    words = " ".join(["wt-finetune", "--config", str(config), *(overrides or [])])
    with kept(folder):
        settings = claim(load(config, overrides or []), folder, load, resume)
        try:
            with bars() as listener:
                outcome = run(
                    settings, folder, made_by=words, listener=listener, track=track,
                    minutes=time_limit,
                )  # fmt: skip
        except KeyboardInterrupt as error:
            raise WorkError(f"interrupted: nothing finished is lost; {again}") from error
    _print(outcome, folder, again)


def _print(outcome: Outcome, folder: Path, again: str) -> None:
    """Print the table, and raise what went wrong in a training."""
    from wt.errors import WorkError
    from wt.finetune.results import table

    if outcome.results is not None:
        print(table(outcome.results))
    where = f"run {outcome.run.id} in {outcome.run.uri}; " if outcome.run else ""
    print(f"{where}files in {folder}")
    if outcome.failed:
        first, *_ = outcome.failed.values()
        if outcome.results is None:
            raise first
        raise WorkError(f"{outcome.errors()}; all else is in the table; {again}") from first


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``wt-finetune``; its exit code.

    Args:
        argv: the arguments; None for those of this process.
    """
    from wt.cli.main import single

    return single(command, "wt-finetune", argv)


if __name__ == "__main__":
    sys.exit(main())
