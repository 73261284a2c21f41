"""``wt-train-policy``, which is ``wt train-policy``: train a walking policy."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer


def command(
    config: Annotated[Path, typer.Option(help="YAML file, or a shipped name, as policy_go2.")],
    overrides: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Override what it says.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the training; runs/policy-<name> by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the training in --out.")
    ] = False,
    start_from: Annotated[
        Path | None, typer.Option(help="Policy, or checkpoint.pt of a training, to begin with.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="Train at most so long, then evaluate and export.")
    ] = None,
    install: Annotated[
        bool, typer.Option("--install", help="Also put the policy into the package.")
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Also write rollout.rrd, a recording for Rerun.")
    ] = False,
) -> None:
    """Train a walking policy by PPO, evaluate it, export it as ONNX with its card.

    The policy tracks commanded velocities of a simulated robot. Its folder holds policy.onnx,
    card.json, the checkpoint to continue from, and a row of training.csv per iteration.

    Example:
        wt-train-policy --config policy_go2 --out runs/go2 --seconds 480
        wt train-policy --config policy_go2 --out runs/go2 --resume
    """
    from wt.cli._extras import need
    from wt.cli._progress import bar
    from wt.errors import ConfigError, WorkError

    need("rsl_rl")  # its extra brings all else
    from wt.locomotion.config import load

    settings = load(config, overrides or [])
    folder = out or Path("runs") / f"policy-{settings.name}"
    if resume and start_from is not None:
        raise ConfigError("--resume and --start-from exclude each other: name one of them")
    words = ["wt-train-policy", *_words(config, overrides or [], start_from, seconds)]
    from wt.locomotion.job import run

    try:
        with bar(f"training {settings.name}") as show:
            table = run(
                settings, folder, made_by=" ".join(words), show=show, resume=resume,
                start_from=start_from, seconds=seconds, install=install, watch=watch,
            )  # fmt: skip
    except KeyboardInterrupt as error:
        raise WorkError(
            "interrupted: nothing finished is lost; continue with: "
            f"wt-train-policy --config {config} --resume --out {folder}"
        ) from error
    print(table)
    print(f"policy, card and checkpoint in {folder}")


def _words(
    config: Path, overrides: Sequence[str], start_from: Path | None, seconds: float | None
) -> list[str]:
    """What was typed, as far as it decides what comes out."""
    words = ["--config", str(config), *overrides]
    words += ["--start-from", str(start_from)] if start_from else []
    return words + (["--seconds", f"{seconds:g}"] if seconds is not None else [])


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``wt-train-policy``; its exit code.

    Args:
        argv: the arguments; None for those of this process.
    """
    from wt.cli.main import single

    return single(command, "wt-train-policy", argv)


if __name__ == "__main__":
    sys.exit(main())
