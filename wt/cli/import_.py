"""``wt import``: a foreign format becomes a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wt.data.labels import checked
from wt.errors import UserError


def command(
    source: Annotated[Path, typer.Argument(help="The file or folder to import.")],
    to: Annotated[
        Path | None,
        typer.Option("--to", help="The recording to write, OUT.parquet; the map with --guess."),
    ] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="YAML that maps names, units and signs.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            help="Write the robot's MJCF here, where the format tells it; with --guess, the MJCF "
            "whose names are looked for.",
        ),
    ] = None,
    guess: Annotated[
        bool, typer.Option("--guess", help="Propose a map, with its doubts, and import nothing.")
    ] = False,
    unit: Annotated[
        str | None, typer.Option(metavar="NAME", help="Which machine of its model this is.")
    ] = None,
    session: Annotated[
        str | None,
        typer.Option(metavar="DATE", help="When it was set up and run, YYYY-MM-DD[THH:MM]."),
    ] = None,
    load: Annotated[
        str | None, typer.Option(metavar="NAME", help="What it carried, or none.")
    ] = None,
) -> None:
    """Turn a robot's log into a recording.

    Reads MCAP files, bags of ROS 1 and 2, CSV tables (PlotJuggler's among them), archives of NumPy,
    MATLAB, PyTorch and HDF5 (ALOHA, robomimic, Isaac Lab), LeRobot episodes, Unitree's LowState,
    and the logs of three laboratories. The format is recognised by itself; what a log leaves open,
    --map settles, and --guess proposes that map. --unit, --session and --load go into the
    recording's metadata, where wt passport reads them; SOURCE may be a recording.

    One line says what came out, among it the median delay from commands to the force or motion
    that answers them. Signs and units that contradict each other are refused, those that look
    wrong are said.

    Example:
        wt import ../shared/recordings/so101/multisine --to multisine.parquet
        wt import log.csv --guess --model arm.xml --to arm.yaml
        wt import run.mcap --map arm.yaml --to run.parquet
        wt import ../shared/recordings/bam_xl330/kp100_sin_sin.json --to a.parquet --model rig.xml
        wt import run.parquet --to labelled.parquet --unit A17 --session 2026-11-25 --load none
    """
    labels = checked(unit, session, load)
    if guess:
        if labels:
            raise UserError(f"--guess imports nothing; leave --{next(iter(labels))} out")
        _guess(source, model, to, map_file)
        return
    if to is None:
        raise UserError("--to OUT.parquet says where the recording goes; give it, or --guess")
    _import(source, to, map_file, model, labels)


def _import(
    source: Path, to: Path, map_file: Path | None, model: Path | None, labels: dict[str, str]
) -> None:
    """Write a recording with these labels, and say what came out."""
    import dataclasses
    import statistics

    from wt.data import recording as recordings
    from wt.data.importers import base
    from wt.show.files import refuse_unwritable

    inputs = [source, *([map_file] if map_file else [])]
    for path, option in ((to, "--to"), (model, "--model")):
        if path is not None and path.resolve() in {p.resolve() for p in inputs}:
            raise UserError(f"{option} {path} is an input too; name another file")
    refuse_unwritable(to.parent, "--to")
    mapping = base.read_map(map_file) if map_file else {}
    recording = base.read(source, mapping)
    recording = dataclasses.replace(recording, meta={**recording.meta, **labels})
    recordings.refuse_to_lose(to, "--to", recording.meta.get("source"), inputs)
    if model is not None:
        from wt.worlds import rigs

        rigs.write_mjcf(rigs.spec_for(recording.meta), model)
    recordings.write_unless_there(recording, to, "--to", recording.meta.get("source"))
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


def _guess(source: Path, model: Path | None, to: Path | None, map_file: Path | None) -> None:
    """Print a map of a log, or write it where nothing is yet."""
    from wt.data.guess.propose import propose
    from wt.data.guess.text import text
    from wt.physics.scene import Scene
    from wt.show.files import refuse_unwritable, write_new

    if map_file is not None:
        raise UserError("--guess proposes a map; leave --map out")
    if to is not None and to.exists():
        raise UserError(f"--to {to} is there already; name another file for the map")
    if to is not None:
        refuse_unwritable(to.parent, "--to")
    proposed = text(propose(source, Scene(model).given if model else None), source)
    if to is None:
        typer.echo(proposed, nl=False)
        return
    to.parent.mkdir(parents=True, exist_ok=True)
    write_new(to, proposed.encode(), "--to")
    doubts = proposed.count("\n#   - ")
    typer.echo(f"{to}: a map of {source.name} with {doubts} doubts; read it, then give it as --map")
