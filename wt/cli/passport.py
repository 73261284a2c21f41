"""``wt passport``: one robot over units, sessions and loads."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wt.errors import UserError, suggest

if TYPE_CHECKING:
    from rich.console import Console

    from wt.passport.card import Card
    from wt.passport.folder import Passport

EXPERIMENT = "passport"
"""Name of the experiment in MLflow."""
SEARCHES = ("each", "first")

app = typer.Typer(
    help="What belongs to the model, the unit, the session and the load; and what changed.",
    no_args_is_help=True,
)

Folder = Annotated[
    Path, typer.Argument(metavar="ROBOT/", help="Folder that wt passport add --out wrote.")
]


@app.command()
def add(
    model: Annotated[Path, typer.Argument(metavar="MODEL.xml", help="The robot's MJCF.")],
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="RECORDING", help="Of wt import --unit … --session … --load …."),
    ],
    out: Annotated[Path, typer.Option(metavar="ROBOT/", help="The passport's folder.")],
    search: Annotated[
        str,
        typer.Option(
            metavar="each|first",
            help="Look for effects in each new group of recordings, or in each unit's first.",
        ),
    ] = "each",
    each_session: Annotated[
        bool,
        typer.Option(
            "--each-session",
            help="Add one session after the other, to learn in which one something changed.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    track: Annotated[bool, typer.Option("--track", help="Log to MLflow too.")] = False,
) -> None:
    """Estimate the same effects in every group of recordings, and add them to a passport.

    Recordings of one unit, session and load are a group. What is found in any group is estimated
    in all of them, and every parameter is put at the highest level that explains it: the model
    (then fix the MJCF), the load, the unit or the session. The folder only grows: each call adds
    one Parquet file of estimates and one JSON file of what was decided.

    Example:
        wt passport add arm.xml a17-*.parquet b04-*.parquet --out robot/
    """
    from rich.console import Console

    from wt.cli._progress import bar
    from wt.passport.add import add as add_recordings
    from wt.passport.card import card
    from wt.passport.text import print_added

    if search not in SEARCHES:
        raise UserError(f"--search {search!r} is unknown; {suggest(search, SEARCHES)}")
    with bar("reading") as progress:
        added = add_recordings(
            model, recordings, out, seed=seed, every_group=search == "each",
            each_session=each_session, progress=progress,
        )  # fmt: skip
    console = Console()
    for path in added.known:
        console.print(f"{path} is in {out} already", highlight=False, soft_wrap=True)
    of = card(added.passport.rows, groups=added.passport.groups)
    if added.files:
        print_added(of, added.groups, console)
        for note in added.passport.additions[-1].notes:
            console.print(f"note: {note}", highlight=False, style="dim")
    for path in added.files:
        console.print(str(path), highlight=False, soft_wrap=True)
    if track and added.files:
        _track(of, out, added.files, console)


@app.command()
def show(
    folder: Folder,
    unit: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only this unit's report card.")
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=VALUE",
            help="Say when a quantity reaches this, where its trend is certain.",
        ),
    ] = None,
    track: Annotated[bool, typer.Option("--track", help="Log to MLflow too.")] = False,
) -> None:
    """Print report cards, and write passport.html into the folder.

    Per unit the state of every joint, drive and sensor, its history with intervals, and what
    changed significantly since the session before, at one false alarm in 100 sessions at most.

    Example:
        wt passport show robot/ --unit A17
        wt passport show robot/ --limit joint.friction_coulomb/elbow/coulomb=0.5
    """
    from rich.console import Console

    from wt.passport.card import card
    from wt.passport.page import MADE_BY, PAGE, page
    from wt.passport.text import print_card
    from wt.show.files import kept, write_whole

    passport = _read(folder)
    units = [_unit(passport, unit)] if unit is not None else list(passport.units)
    of = card(passport.rows, _limits(passport, limit or ()), passport.groups)
    path = folder / PAGE
    if path.exists() and MADE_BY not in path.read_text(encoding="utf-8", errors="replace"):
        raise UserError(f"{path} is there and no wt passport wrote it; move it")
    with kept(folder, "ROBOT/"):
        write_whole(path, page(passport, of, units, folder.resolve().name))
    console = Console()
    print_card(of, units, console, passport.parts)
    console.print(f"\n{path}", highlight=False, soft_wrap=True)
    if track:
        _track(of, folder, (path,), console)


@app.command()
def diff(
    folder: Folder,
    one: Annotated[str, typer.Argument(metavar="UNIT", help="A unit, e.g. A17.")],
    other: Annotated[str, typer.Argument(metavar="OTHER", help="Another, e.g. B04.")],
) -> None:
    """Say what two units differ by, with intervals.

    Example:
        wt passport diff robot/ A17 B04
    """
    from rich.console import Console

    from wt.passport.card import card, differences
    from wt.passport.text import print_difference

    passport = _read(folder)
    names = [_unit(passport, name) for name in (one, other)]
    if one == other:
        raise UserError(f"{one} and {other} are the same unit; name two")
    of = card(passport.rows, groups=passport.groups)
    print_difference(differences(of, *names), one, other, Console())


def _read(folder: Path) -> Passport:
    from wt.passport.folder import read

    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder} is a file; give the folder that wt passport add --out wrote")
    passport = read(folder)
    if not passport.additions:
        raise UserError(
            f"{folder} holds no passport; make one: wt passport add MODEL.xml RECORDING... --out "
            f"{folder}"
        )
    return passport


def _unit(passport: Passport, name: str) -> str:
    if name not in passport.units:
        raise UserError(f"unit {name!r} is not in this passport; {suggest(name, passport.units)}")
    return name


def _limits(passport: Passport, given: Sequence[str]) -> dict[str, float]:
    known = {str(row.quantity) for row in passport.rows}
    limits = {}
    for text in given:
        name, _, value = text.rpartition("=")
        try:
            limits[name] = float(value)
        except ValueError as error:
            raise UserError(
                f"--limit {text!r} is no QUANTITY=VALUE, as in {min(known, default='…')}=0.5"
            ) from error
        if name not in known:
            raise UserError(f"--limit {name!r} is not in this passport; {suggest(name, known)}")
    return limits


def _track(of: Card, folder: Path, files: Sequence[Path], console: Console) -> None:
    """One run in MLflow: each unit's values, the levels, and the files that were written."""
    from wt.run import track

    with track.run(EXPERIMENT, folder.resolve().name) as run:
        run.params({_loggable(f"level/{q}"): placed.level for q, placed in of.levels.items()})
        values = {
            _loggable(f"{unit}/{q}"): state.value.value
            for unit, states in of.states.items()
            for q, state in states.items()
        }
        run.metrics({**values, "alarms": len(of.alarms)}, step=len(of.labels))
        for path in files:
            run.artifact(path)
    console.print(f"run {run.id} in {run.uri}", highlight=False, soft_wrap=True)


def _loggable(name: str) -> str:
    """A name without what MLflow does not take, as the + of a pair of joints."""
    return re.sub(r"[^\w./ :-]", "_", name)
