"""``wt diagnose``: which physics the model leaves out, from recordings of the real machine."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperCommand

from wt.cli._extras import need
from wt.errors import UserError

if TYPE_CHECKING:
    from rich.console import Console
    from typer._click.core import Context  # typer.Context is a subclass

    from wt.diagnose.observed.translation import TrainedTranslation
    from wt.diagnose.pace import Expected
    from wt.diagnose.result import Decision, Diagnosis

EXPERIMENT = "diagnose"
"""Name of the experiment in MLflow."""
_ONCE = "Ctrl-C once more ends the search and writes what is known by now; until then it goes on"
_ENDING = "ending the search; what is known is proven and written"
_AGAIN = f"{_ENDING} (Ctrl-C once more: nothing is)"
QUICK_S = 5.0
"""Where even an effect is found sooner than this [s], nothing is said of how long it will take."""


TranslationOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME@ALIAS",
        help="A model of wt fit between MODEL.xml and this robot, as further evidence.",
    ),
]
HoldoutOption = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="RECORDING...",
        help="Only for the proof; one or several. By default the last ones, or the last quarter of "
        "a single one.",
    ),
]
SuggestOption = Annotated[
    Path | None,
    typer.Option(metavar="OUT.parquet", help="Write the commands to record next."),
]
WhyOption = Annotated[
    str | None,
    typer.Option(
        metavar="PLACE",
        help="Print every decision at a joint, actuator or body; without MODEL.xml those of the "
        "diagnosis in --out.",
    ),
]
PlanOption = Annotated[
    bool,
    typer.Option(
        "--plan",
        help="Without recordings: which causes could be told apart at all, and by which motion.",
    ),
]
BundleOption = Annotated[
    bool,
    typer.Option(
        "--bundle", help="Copy the model's meshes and textures into OUT/assets, to take it along."
    ),
]
JobsOption = Annotated[
    str | None,
    typer.Option(
        metavar="N|ray",
        help="Replay on N cores, or spread over a Ray cluster: the one that RAY_ADDRESS names, "
        "else one of this machine's cores. Same answer.  [default: all cores]",
    ),
]
LimitOption = Annotated[
    float | None,
    typer.Option(
        metavar="MINUTES",
        min=0.01,
        help="End the search after so long; what is known by then is proven and written, which "
        "takes a while more. As Ctrl-C twice does.",
    ),
]


class Command(TyperCommand):
    """Lets one ``--holdout`` take several files, up to the next option."""

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:
        """Parse as usual, with ``--holdout a b`` read as ``--holdout a --holdout b``."""
        return list(super().parse_args(ctx, repeated(args, "--holdout")))


def repeated(args: Sequence[str], option: str) -> list[str]:
    """Arguments with ``option`` repeated before each of the values that follow it."""
    unpacked: list[str] = []
    inside = first = False
    for arg in args:
        if arg.startswith("-"):
            inside = first = arg == option
        elif inside and not first:
            unpacked.append(option)
        else:
            first = False
        unpacked.append(arg)
    return unpacked


def command(
    *,
    model: Annotated[
        Path | None, typer.Argument(metavar="MODEL.xml", help="The robot's MJCF.")
    ] = None,
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="RECORDING", help="What the real robot did.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the report and the patched model.")],
    holdout: HoldoutOption = None,
    track: Annotated[bool, typer.Option("--track", help="Log to MLflow too.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    suggest_experiment: SuggestOption = None,
    translation: TranslationOption = None,
    jobs: JobsOption = None,
    time_limit: LimitOption = None,
    why: WhyOption = None,
    bundle: BundleOption = False,
    plan: PlanOption = False,
) -> None:
    """Locate, name, model and prove what the simulator leaves out.

    Says where the recordings and the model's replay part, which physics is missing, and how much
    better the written files predict data that nothing was fitted to. Writes report.html,
    model.xml (the patched MJCF), diagnosis.json, diagnosis.rrd, holdout.npz (see wt verify), and
    where they are needed physics.py, for what MJCF cannot say, and residual.onnx, a learned
    remainder. Finding nothing is an answer too: exit code 0.

    Example:
        wt diagnose robot.xml walk1.parquet walk2.parquet --holdout walk3.parquet --out diagnosis
        wt diagnose go2.xml walk.parquet --translation wt-go2-flat@champion --out diagnosis
        wt diagnose --out diagnosis --why elbow
        wt diagnose robot.xml --plan --out plan
    """
    if plan or model is None or not recordings:
        return _unrecorded(model, recordings or (), out, why, plan)
    if track:
        need("mlflow")
    from wt.diagnose.pipeline import diagnose

    inputs = [model, *recordings, *(holdout or ())]
    if suggest_experiment is not None:
        _refuse_to_lose(suggest_experiment, inputs)
    translator = _registered(translation) if translation else None
    with _working(out, inputs, jobs, bundle, time_limit) as (write, progress):
        diagnosis = diagnose(
            model, recordings, holdout or (), seed=seed, progress=progress, expect=_print_expected,
            translation=translator,
        )  # fmt: skip
        progress("writing", 0.98)
        write(diagnosis)
    console = printed(diagnosis, out)
    if why:
        _print_decisions(diagnosis.decisions, why)
    if suggest_experiment is not None:
        _suggest(diagnosis, model, suggest_experiment, console)
    if track:
        _track(diagnosis, out, seed, console)


def _unrecorded(
    model: Path | None, recordings: Sequence[Path], out: Path, why: str | None, plan: bool
) -> None:
    """What needs no recordings: a plan, or the decisions of an earlier diagnosis."""
    if plan:
        if model is None or recordings:
            raise UserError("--plan takes MODEL.xml alone: it is for before anything is recorded")
        from wt.cli._plan import write_plan

        return write_plan(model, out)
    if why is None or model is not None:
        raise UserError("name MODEL.xml and at least one RECORDING; see wt diagnose --help")
    return _print_decisions(_decisions_in(out), why)


def printed(diagnosis: Diagnosis, out: Path) -> Console:
    """Print what was found and where the report is; gives what it was printed on."""
    from rich.console import Console

    from wt.diagnose.report.text import print_summary

    console = Console()
    print_summary(diagnosis, console)
    console.print(f"\n{out / 'report.html'}", highlight=False, soft_wrap=True)
    return console


def _print_expected(expected: Expected) -> None:
    """Say how long it will take, unless it is quick even where an effect is found."""
    if expected.of(1) > QUICK_S:
        print(expected, file=sys.stderr, flush=True)


@contextlib.contextmanager
def _working(
    out: Path, inputs: Sequence[Path], jobs: str | None, bundle: bool, time_limit: float | None
) -> Iterator[tuple[Callable[[Diagnosis], None], Callable[[str, float], None]]]:
    """Keep the folder, and show how far the work is; yields what writes into it, and the bar."""
    from wt.cli._interrupts import twice
    from wt.cli._progress import bar
    from wt.diagnose.report.write import claimed
    from wt.diagnose.stop import stop_when
    from wt.physics.spread import over

    if bundle:
        _refuse_what_cannot_travel(inputs[0])
    with (
        warnings.catch_warnings(),
        claimed(out, inputs, bundle) as write,
        bar("reading", timed=True) as progress,
        over(jobs),
        twice(_ONCE, _AGAIN) as asked,
        stop_when(_ending(asked, time_limit)),
    ):
        if os.environ.get("WT_DEBUG", "0") in ("", "0"):
            # what numpy and MuJoCo say to programmers is no line for users
            warnings.simplefilter("ignore", RuntimeWarning)
            warnings.simplefilter("ignore", UserWarning)
        yield write, progress


def _ending(asked: Callable[[], bool], time_limit: float | None) -> Callable[[], bool]:
    """Tells whether the search is to end: it was asked to, or its minutes are over."""
    if time_limit is None:
        return asked
    end, said = time.monotonic() + 60.0 * time_limit, False

    def ending() -> bool:
        nonlocal said
        over = time.monotonic() > end
        if over and not said:
            print(f"\nthe {time_limit:g} min are over: {_ENDING}", file=sys.stderr, flush=True)
            said = True
        return over or asked()

    return ending


def _registered(reference: str) -> TrainedTranslation:
    from wt.registered import translation

    return translation(reference)


def _decisions_in(out: Path) -> list[Decision]:
    """Decisions of a diagnosis that was written earlier."""
    from wt.diagnose.result import Decision

    path = out / "diagnosis.json"
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["decisions"]
        return [Decision.from_json(entry) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: no diagnosis with decisions; name MODEL.xml too") from error


def _print_decisions(decisions: Sequence[Decision], place: str) -> None:
    from rich.console import Console

    from wt.diagnose.report.text import why

    Console().print(why(decisions, place))


def _refuse_what_cannot_travel(model: Path) -> None:
    from wt.mjcf.bundle import bundled
    from wt.mjcf.edit import patched_xml
    from wt.physics.scene import Scene

    bundled(patched_xml(Scene(model), (), ()))


def _refuse_to_lose(suggestion: Path, inputs: Sequence[Path]) -> None:
    from wt.data import recording
    from wt.diagnose.experiment import SOURCE

    recording.refuse_to_lose(suggestion, "--suggest-experiment", SOURCE, inputs)


def _suggest(diagnosis: Diagnosis, model: Path, path: Path, console: Console) -> None:
    from wt.data import recording
    from wt.diagnose.experiment.excite import suggest
    from wt.diagnose.experiment.release import passive, release
    from wt.physics.scene import Scene

    scene = Scene(model)
    if passive(scene):
        words = f"Nothing drives {model.name}, so there are no commands to record next: "
        console.print(f"{words}{release(scene, diagnosis.traces)}.", highlight=False)
        return
    recording.write(suggest(diagnosis, model), path)
    console.print(f"{path}: commands to record next", highlight=False, soft_wrap=True)


def _track(diagnosis: Diagnosis, out: Path, seed: int, console: Console) -> None:
    """One run in MLflow: what was given, how well it fits, and every file that was written."""
    from wt.run import track

    h = diagnosis.proof.holdout
    with track.run(EXPERIMENT, Path(diagnosis.model_path).stem) as run:
        run.params(
            {
                "model": diagnosis.model_path,
                "model_sha256": diagnosis.model_sha256,
                "recordings": [r.path for r in diagnosis.recordings],
                "seed": seed,
                "verdict": diagnosis.verdict,
                "effects": [f"{f.effect} at {f.at}" for f in diagnosis.findings],
            }
        )
        values = {
            "holdout/before_rmse": h.before,
            "holdout/after_rmse": h.after,
            "holdout/noise_floor_rmse": h.noise_floor,
            "holdout/ratio": h.ratio,
            "holdout/ratio_model_only": (diagnosis.proof.model_only or h).ratio,
            "findings": len(diagnosis.findings),
            "seconds": diagnosis.seconds,
        }
        for f in diagnosis.findings:
            for name, estimate in f.parameters.items():
                if isinstance(estimate.value, float):
                    values[f"{f.effect}/{f.at.name}/{name}"] = estimate.value
        run.metrics(values, step=0)
        for name in diagnosis.to_json()["artifacts"].values():
            if name:
                run.artifact(out / name)
        run.artifact(out / "diagnosis.json")
    console.print(f"run {run.id} in {run.uri}", highlight=False, soft_wrap=True)
