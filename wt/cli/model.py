"""``wt model``: the MJCF of a robot of the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    robot: Annotated[str, typer.Argument(help="go2 or g1.")],
    to: Annotated[
        Path | None, typer.Option("--to", metavar="OUT.xml", help="Write it there instead.")
    ] = None,
    hung: Annotated[
        bool, typer.Option("--hung", help="Its trunk is held in the air: no free joint.")
    ] = False,
) -> None:
    """Print the MJCF of a robot that the package has, to diagnose recordings of it with.

    Joints, actuators and sensors have the names of the columns that wt-run records.

    Example:
        wt model go2 > go2.xml
        wt model go2 --hung --to hung.xml
        wt diagnose go2.xml runs/go2-2026-11-21T10-00-00/recording.parquet --out diagnosis
    """
    from wt.errors import UserError
    from wt.show.files import write_whole
    from wt.worlds.robots import mjcf

    text = mjcf(robot, hung=hung)
    if to is None:
        typer.echo(text, nl=False)
        return
    if to.exists():
        raise UserError(f"--to: {to} exists; name a new file")
    to.parent.mkdir(parents=True, exist_ok=True)
    write_whole(to, text)
    typer.echo(str(to))
