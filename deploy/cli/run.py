"""``wt-run``: run a policy on a robot."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

RobotName = Literal["go2"]
PlayOption = Annotated[
    Path | None,
    typer.Option(help="Instead of a policy: commands of wt ask, trunk held in the air."),
]
ModelOption = Annotated[
    Path | None, typer.Option(help="MJCF that they were made for: gains of the drives.")
]
LimitsArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Change a safety limit.")
]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Compute everything, send nothing.")]
RecoverOption = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Run nothing: write the files of a run that was killed with all of it."
    ),
]
PassportOption = Annotated[
    Path | None, typer.Option(help="The robot's: a line says when it is no longer the one in it.")
]
UnitOption = Annotated[str, typer.Option(help="Which unit of it [default: the only one].")]
LoadOption = Annotated[
    str, typer.Option(help="What it carries [default: none, or the only load it ever carried].")
]


def command(
    policy: Annotated[
        str, typer.Option(help="NAME@ALIAS or NAME/VERSION of the registry, a folder, or go2.")
    ] = "",
    play: PlayOption = None,
    model: ModelOption = None,
    limits: LimitsArgument = None,
    robot: Annotated[RobotName, typer.Option(help="What to run it on.")] = "go2",
    interface: Annotated[
        str, typer.Option(help="Network interface of the robot; lo for wt-sim-go2.")
    ] = "lo",
    domain: Annotated[int, typer.Option(help="DDS domain.")] = 0,
    seconds: Annotated[float | None, typer.Option(min=0, help="End after so long.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of recording and log [default: runs/go2-<time>].")
    ] = None,
    dry_run: DryRunOption = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Run before all else (root, or ulimit -r 20).")
    ] = False,
    passport: PassportOption = None,
    unit: UnitOption = "",
    load: LoadOption = "",
    recover: RecoverOption = None,
) -> None:
    """Run a policy on a robot: passive, stand up, policy, damping, as the operator says.

    Keys: 1 stand up, 2 policy, space damping, x end; w/s, a/d, q/e walk and turn, 0 stand still.
    Remote: L2+A stand up, start policy, L2+B damping, sticks walk and turn.
    Ctrl-C ends in damping. A fault ends in damping, too, and stays until the program ends.
    With --play its trunk is to hang in the air: it "stands up" to where the commands begin, and
    the commands take the policy's place, once; after a fault the program ends by itself.

    Example:
        wt-sim-go2 &
        wt-run --robot go2 --policy go2 --interface lo
        wt-run --robot go2 --policy go2@champion --interface eth0 --dry-run
        wt-run --play asked/experiment_1.parquet --model go2_hung.xml
        wt-run --recover runs/go2-2026-11-21T10-00-00
    """
    from deploy.job import RunOptions, run
    from deploy.job import play as play_commands
    from deploy.job import recover as recover_run
    from wt.errors import UserError

    if recover is not None:
        return recover_run(recover)
    if bool(policy) == (play is not None):
        raise UserError("give one of --policy and --play")
    if (play is None) != (model is None):
        raise UserError("--play COMMANDS.parquet and --model MODEL.xml go together")
    options = RunOptions(
        interface, domain, limits or [], seconds, out, dry_run, realtime, passport, unit, load
    )
    if play is not None and model is not None:
        play_commands(play, model, options)
    else:
        run(policy, options)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``wt-run``; its exit code.

    Args:
        argv: the arguments; None for those of this process.
    """
    from wt.cli.main import single

    return single(command, "wt-run", argv)


if __name__ == "__main__":
    sys.exit(main())
