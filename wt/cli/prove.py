"""``wt prove``: the concealed trials of ``wt diagnose``, sealed, blind, and scored."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wt.cli._extras import need
from wt.errors import ConfigError, WorkError

if TYPE_CHECKING:
    from wt.prove.folder import Folder


def command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Ten cases: at most 10 minutes on 2 cores.")
    ] = False,
    set_name: Annotated[
        str | None,
        typer.Option("--set", help="Cases: full (default), or one kind of them, as 'nulls'."),
    ] = None,
    only: Annotated[str, typer.Option(help="Part of the names of cases, or a pattern.")] = "",
    seed: Annotated[int, typer.Option(min=0, help="Of everything that is hidden.")] = 0,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Diagnoses side by side.  [default: one a core]")
    ] = None,
    rivals: Annotated[
        bool | None,
        typer.Option(help="Rivals on the same cases.  [default: with the full set]"),
    ] = None,
    machines: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Recordings of real machines, to score on too."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the trial; runs/prove-<time> by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the interrupted trial in --out.")
    ] = False,
    bring: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Cases made by somebody else.")
    ] = None,
    key: Annotated[
        str | None, typer.Option(help="Key of their seals, a file or its digits; to score.")
    ] = None,
    seal: Annotated[
        Path | None,
        typer.Option(metavar="ANSWERS.json", help="Seal answers of --bring, and stop."),
    ] = None,
) -> None:
    """Prove wt diagnose on data where the effect is concealed.

    Hides physics in simulated machines, seals the answers, lets wt diagnose work on the recordings
    alone, in processes that reach neither answers nor seed, opens the seals and prints the score.
    Writes results.json, report.html and trials.rrd. For cases of your own see docs/prove.md.

    Example:
        wt prove --quick
        wt prove --bring cases --seal answers.json
        wt prove --bring cases --out trial && wt prove --resume --out trial --key cases.key
    """
    _check(quick, set_name, rivals, out, resume, bring, seal)
    if seal is not None and bring is not None:
        return _seal(bring, seal)
    folder = _folder(quick, set_name, only, seed, rivals, machines, out, resume, bring)
    try:
        _run(folder, jobs or os.cpu_count() or 1, key)
    except KeyboardInterrupt as error:
        raise WorkError(
            "interrupted: nothing finished is lost; continue with: "
            f"wt prove --resume --out {folder.path}"
        ) from error


def _seal(bring: Path, answers: Path) -> None:
    from wt.prove.bring import seal_all

    kept = seal_all(bring, answers)
    typer.echo(f"{bring}: sealed; the key is in {kept}: keep it and {answers} to yourself")


def _check(
    quick: bool,
    set_name: str | None,
    rivals: bool | None,
    out: Path | None,
    resume: bool,
    bring: Path | None,
    seal: Path | None,
) -> None:
    if quick and set_name:
        raise ConfigError("--quick is a set of its own: give it or --set, not both")
    if rivals and set_name in ("ask", "fleet"):
        raise ConfigError(
            f"rivals do not ask, and keep no passports: leave --rivals out with --set {set_name}"
        )
    if resume and out is None:
        raise ConfigError("--resume needs --out: the folder of the trial to continue")
    if resume and (quick or set_name or bring):
        raise ConfigError("--resume goes on with the cases it began with: name no others")
    if seal is not None and bring is None:
        raise ConfigError("--seal needs --bring: the folder of the cases that are sealed")
    if bring is not None and (quick or set_name):
        raise ConfigError("--bring names the cases: leave --quick and --set out")


def _folder(
    quick: bool,
    set_name: str | None,
    only: str,
    seed: int,
    rivals: bool | None,
    machines: Path | None,
    out: Path | None,
    resume: bool,
    bring: Path | None,
) -> Folder:
    name = "" if bring else set_name or ("brief" if quick else "full")
    compete = rivals if rivals is not None else name == "full"
    if compete and not resume:
        need("absl", "pysindy")
    from wt.prove.bench import chosen
    from wt.prove.contenders import of_set
    from wt.prove.folder import Folder, Plan, code
    from wt.prove.real import present

    if resume and out is not None:
        return Folder.resume(out)
    if machines is not None:
        present(machines)
    if not bring:
        chosen(name, only, seed)  # a wrong name fails before anything is written
    plan = Plan(
        set=name,
        only=only,
        seed=seed,
        who=of_set(name, compete),
        brought=str(bring.resolve()) if bring else "",
        code=code(),
        machines=str(machines.resolve()) if machines else "",
    )
    path = out or Path("runs") / f"prove-{datetime.now():%Y-%m-%dT%H-%M-%S}"
    if bring:
        _ = Folder(path, plan).manifest
    return Folder.begin(path, plan)


def _run(folder: Folder, jobs: int, key: str | None) -> None:
    from rich.console import Console

    from wt.cli._progress import bar
    from wt.prove import bench, results
    from wt.prove.finish import REPORT, finish
    from wt.prove.seal import read_key

    given = read_key(key) if key else None
    with bar("making cases") as say:
        bench.make(folder, jobs, say)
        bench.diagnose(folder, jobs, say)
        if folder.plan.brought and given is None:
            typer.echo(
                f"{folder.path / 'ledger.json'}: hashes of everything that was said; to score, "
                f"ask for the key and run: wt prove --resume --out {folder.path} --key KEY"
            )
            return
        scored = finish(folder, given, jobs, say)
    console = Console()
    console.print(results.table(scored))
    if (real := results.machines(scored)) is not None:
        console.print("", real, sep="\n")
    for line in results.lines(scored):
        console.print(line, highlight=False, soft_wrap=True)
    if folder.left_out:
        named = ", ".join(folder.left_out)
        console.print(f"Left out, since the robot falls whatever it does: {named}")
    console.print(f"\n{folder.path / REPORT}", highlight=False, soft_wrap=True)
