"""``wt-finetune``, which is ``wt finetune``: adapt a walking policy to translated dynamics."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer


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
) -> None:
    """Fine-tune a walking policy on translated dynamics, beside its rivals, and judge all in R.

    The simulator's transitions are translated at every control step by a model of the registry;
    rsl_rl's PPO goes on from the base policy. Prints tracking, stability and power of every variant
    in R on one sequence of commands, the paper's beside them. The folder of each variant holds
    policy.onnx, card.json, the checkpoint and a recording for Rerun.

    Example:
        wt-finetune --config finetune_go2 seeds=[0]
        wt finetune --config finetune_go2 --out runs/tuned --resume
    """
    from datetime import datetime

    from wt.cli._extras import need
    from wt.cli._progress import bar
    from wt.errors import ConfigError, WorkError

    need("rsl_rl")  # its extra brings all else
    from wt.finetune.config import load
    from wt.locomotion.job import find_rsl_rl

    find_rsl_rl()
    from wt.finetune.job import run
    from wt.finetune.results import table
    from wt.run.folder import CONFIG, claim
    from wt.show.files import kept

    if resume and out is None:
        raise ConfigError("--resume needs --out: the folder of the run to continue")
    folder = out or Path("runs") / f"finetune-{datetime.now():%Y-%m-%dT%H-%M-%S}"
    words = " ".join(["wt-finetune", "--config", str(config), *(overrides or [])])
    with kept(folder):
        settings = claim(load(config, overrides or []), folder, load, resume)
        try:
            with bar("fine-tuning") as show:
                results, tracked = run(settings, folder, made_by=words, show=show)
        except KeyboardInterrupt as error:
            raise WorkError(
                "interrupted: nothing finished is lost; continue with: "
                f"wt-finetune --config {folder / CONFIG} --resume --out {folder}"
            ) from error
    print(table(results))
    print(f"run {tracked.id} in {tracked.uri}; files in {folder}")


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``wt-finetune``; its exit code.

    Args:
        argv: the arguments; None for those of this process.
    """
    from wt.cli.main import single

    return single(command, "wt-finetune", argv)


if __name__ == "__main__":
    sys.exit(main())
