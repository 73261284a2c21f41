"""``wt check``: does a model, or a recording, say what it claims?"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wt.errors import UserError

if TYPE_CHECKING:
    from wt.check.finding import AuditFinding

_MODELS = (".xml", ".mjcf", ".urdf")


def command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="[MODEL.xml] [RECORDING]...", help="The simulator's MJCF, recordings, or both."
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for check.html and --fix.")] = None,
    fix: Annotated[
        bool, typer.Option("--fix", help="Write what was corrected into --out DIR.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Audit a model and recordings before any physics is suspected.

    Looks for signs, orders, units, scales, clocks and wraps that are not what the file claims,
    commands that were not the commands, velocities that are not velocities, gravity that one side
    compensates, and models that do not run. Each line says what is wrong, where, how it is known,
    and the fix. With --out DIR a page shows each channel against the model's replay; --fix writes
    the corrected files beside it, never over what was given.

    Exit code 0: clean. 1: something was found. 2: it cannot be read, or nothing can be written.

    Example:
        wt check robot.xml walk1.parquet walk2.parquet --out check --fix
        wt check walk1.parquet
    """
    import json

    from wt.check.files import audit, merged, outputs
    from wt.check.page import page
    from wt.cli._progress import bar

    models = [f for f in files if f.suffix.lower() in _MODELS]
    if len(models) > 1:
        raise UserError(f"'{models[0]}' and '{models[1]}' are both models; give one")
    if fix and out is None:
        raise UserError("--fix needs --out DIR: corrected files never replace what was given")
    model, sources = (models[0] if models else None), [f for f in files if f not in models]
    with _failing(), outputs(out) if out is not None else contextlib.nullcontext() as into:
        with bar("reading") as progress:
            audited = audit(model, sources, progress)
        findings = merged(audited)
        if as_json:
            typer.echo(json.dumps([f.to_json() for f in findings], indent=2, ensure_ascii=False))
        else:
            _print(findings)
        if into is not None:
            written = into.fixed(model, audited) if fix else []
            for path in (*written, into.page(page(model, audited))):
                typer.echo(str(path), err=as_json)
    if any(f.sure for f in findings):
        raise typer.Exit(1)


@contextlib.contextmanager
def _failing() -> Iterator[None]:
    """Whatever fails ends in exit code 2: 1 says that something was found."""
    from wt.cli.main import explain

    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(explain(error)[0]) from error


def _print(findings: list[AuditFinding]) -> None:
    """Kind and place of each in bold, evidence and fix below: whole words at any width."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console()
    faults = [f for f in findings if f.sure]
    for f in faults:
        where = ", ".join(f.columns or f.elements)
        console.print(Text(f"{f.kind}  {where}".rstrip(), "bold"))
        for text in filter(None, (f.evidence, f.fix)):
            console.print(Padding(Text(text), (0, 0, 0, 2), expand=False))
    if not faults:
        console.print("Clean: nothing is wrong with what was given.", highlight=False)
    for f in findings:
        if not f.sure:
            console.print(Text(f"note: {f.evidence}; {f.fix}", "dim"))
