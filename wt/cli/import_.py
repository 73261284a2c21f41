"""``wt import``: a foreign format becomes a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wt.errors import UserError


def command(
    source: Annotated[Path, typer.Argument(help="The file or folder to import.")],
    to: Annotated[Path, typer.Option("--to", help="The recording to write, OUT.parquet.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", help="YAML that maps names, units and signs.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option("--model", help="Write the robot's MJCF here, where the format tells it."),
    ] = None,
) -> None:
    """Turn a robot's log into a recording.

    Reads MCAP files and ROS 2 bags (JointState, JointTrajectory, Float64MultiArray, Imu,
    Odometry), CSV tables, NumPy archives, LeRobot episodes, SO-101 motion folders, logs of the
    XL330 servo bench and runs of the DFKI double pendulum. The format is recognised by itself.

    One line says what came out, among it the median delay from commands to the force or motion
    that answers them. Signs and units that contradict each other are refused, those that look
    wrong are said.

    Example:
        wt import ../shared/recordings/so101/multisine --to multisine.parquet
        wt import run.mcap --map arm.yaml --to run.parquet
        wt import ../shared/recordings/bam_xl330/kp100_sin_sin.json --to a.parquet --model rig.xml
    """
    import statistics

    from wt.data import recording as recordings
    from wt.data.importers import base

    inputs = [source, *([map_file] if map_file else [])]
    for path, option in ((to, "--to"), (model, "--model")):
        if path is not None and path.resolve() in {p.resolve() for p in inputs}:
            raise UserError(f"{option} {path} is an input too; name another file")
    mapping = base.read_map(map_file) if map_file else {}
    recording = base.read(source, mapping)
    recordings.refuse_to_lose(to, "--to", recording.meta.get("source"), inputs)
    if model is not None:
        from wt.worlds import rigs

        rigs.write_mjcf(rigs.spec_for(recording.meta), model)
    recordings.write(recording, to)
    delays = base.delays(recording).values()
    delay = f"{1e3 * statistics.median(delays):.0f} ms" if delays else "not measurable"
    clock = recording.meta.get("clock")
    typer.echo(
        f"{to}: {len(recording.columns)} columns, {recording.seconds:.1f} s at "
        f"{recording.rate_hz:.2f} Hz, median command-to-response delay {delay}"
        + (f", time from {clock}" if clock else "")
    )
    assumed = recording.meta.get("assumed")
    notes = [str(note) for note in assumed] if isinstance(assumed, list) else []
    for note in notes + base.doubts(recording, mapping):
        typer.echo(f"note: {note}", err=True)
