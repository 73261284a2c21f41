"""``wt-sim-go2``: a simulated Go2 on the network, as if it were a real one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer


def command(
    remote: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SECONDS:WHAT]...", help="What a scripted remote control does."),
    ] = None,
    interface: Annotated[str, typer.Option(help="Network interface to be reached on.")] = "lo",
    domain: Annotated[int, typer.Option(help="DDS domain.")] = 0,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="End so long after the first command.")
    ] = None,
    fault: Annotated[
        str | None,
        typer.Option(help="drop@S, delay@S, nan@S or flip@S: what goes wrong, and when."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for a recording of the truth.")] = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Run before all else (root, or ulimit -r 20).")
    ] = False,
    hung: Annotated[bool, typer.Option("--hung", help="Its trunk is held in the air.")] = False,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MACHINE.xml",
            help="It is this Go2, not the published one: what `wt model go2 [--hung]` prints, with "
            "something changed to be found.",
        ),
    ] = None,
) -> None:
    """Simulate a Go2 behind the topics of a real one: rt/lowcmd in, rt/lowstate out.

    It lies on the floor and does what its drives are told. A scripted remote control (stand,
    policy, walk=FORWARD,LEFT,TURN in shares of the largest command, damping) makes it an operator,
    too; its clock starts with the first command.

    Example:
        wt-sim-go2
        wt-sim-go2 1:stand 5:policy 6:walk=0.5 11:walk=0 12:damping --seconds 13
        wt-sim-go2 1:stand 5:policy --fault drop@7 --seconds 9
        wt-sim-go2 --model worn.xml
    """
    from deploy.job import simulate
    from wt.errors import UserError

    if hung and model:
        raise UserError("--hung and --model were both given; the model says whether it hangs")
    simulate(
        interface=interface, domain=domain, remote=remote or [], fault=fault, seconds=seconds,
        out=out, realtime=realtime, hung=hung, model=model,
    )  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``wt-sim-go2``; its exit code.

    Args:
        argv: the arguments; None for those of this process.
    """
    from wt.cli.main import single

    return single(command, "wt-sim-go2", argv)


if __name__ == "__main__":
    sys.exit(main())
