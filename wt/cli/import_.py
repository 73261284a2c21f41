"""``wt import``: a foreign format becomes a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    source: Annotated[Path, typer.Argument(help="The file or folder to import.")],
    to: Annotated[Path, typer.Option("--to", help="The recording to write, OUT.parquet.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", help="YAML that maps names and units.")
    ] = None,
) -> None:
    """Turn CSV tables and the SO-101 motion folders into a recording.

    The format is recognised by itself. One line says what came out, among it the median delay
    from commands to motion.

    Example:
        wt import ../shared/recordings/so101/multisine --to multisine.parquet
    """
    from wt.data import recording as recordings
    from wt.data.importers import base

    recording = base.read(source, base.read_map(map_file) if map_file else {})
    recordings.write(recording, to)
    delay = recordings.response_delay(recording)
    typer.echo(
        f"{to}: {len(recording.columns)} columns, {recording.seconds:.1f} s at "
        f"{recording.rate_hz:.2f} Hz, median command-to-response delay "
        + (f"{1e3 * delay:.0f} ms" if delay is not None else "not measurable (nothing moves)")
    )
