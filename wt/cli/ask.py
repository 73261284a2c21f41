"""``wt ask``: experiments that settle what recordings leave open, designed and run in a loop."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wt.errors import UserError, suggest

if TYPE_CHECKING:
    from wt.ask.loop import Wish
    from wt.ask.robot import Robot
    from wt.diagnose.result import Diagnosis
    from wt.types import Recording

ROBOTS = ("file", "sim", "go2")

RobotOption = Annotated[
    str,
    typer.Option(
        metavar="file|sim|go2",
        help="file: a person takes commands from OUT/experiment_N.parquet and puts what was "
        "measured at OUT/recorded_N.parquet. sim: the machine in --world. go2: a Go2 that hangs "
        "in the air, through wt-run, whose keys start and stop it.",
    ),
]
WorldOption = Annotated[
    Path | None,
    typer.Option(metavar="WORLD.xml", help="MJCF of the machine that --robot sim is."),
]
NoiseOption = Annotated[float, typer.Option(min=0.0, help="Deviation of its encoders [rad or m].")]
PrecisionOption = Annotated[
    float | None,
    typer.Option(
        metavar="SHARE",
        help="Go on until every parameter's 95 % interval is ± this share of its value.",
    ),
]
RangeOption = Annotated[
    bool,
    typer.Option(
        "--whole-range",
        help="The model's joint ranges are free of obstacles: go anywhere in them. Without it "
        "joints go only a little beyond what was recorded.",
    ),
]
InterfaceOption = Annotated[
    str, typer.Option(help="Network interface of --robot go2; lo for wt-sim-go2 --hung.")
]
DomainOption = Annotated[int, typer.Option(help="DDS domain of --robot go2.")]
LimitOption = Annotated[
    list[str] | None,
    typer.Option(metavar="KEY=VALUE", help="A limit at which wt-run stops, for --robot go2."),
]
WaitOption = Annotated[float, typer.Option(help="Longest wait for a recording [s].")]


def command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.xml", help="The robot's MJCF.")],
    out: Annotated[Path, typer.Option(help="Folder for experiments, recordings and diagnosis.")],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RECORDING]...", help="What the robot did so far."),
    ] = None,
    robot: RobotOption = "file",
    world: WorldOption = None,
    noise: NoiseOption = 1e-4,
    seconds: Annotated[float, typer.Option(help="Length of an experiment [s].")] = 20.0,
    most: Annotated[int, typer.Option(min=1, help="Experiments at most.")] = 3,
    precision: PrecisionOption = None,
    whole_range: RangeOption = False,
    wait: WaitOption = 3600.0,
    interface: InterfaceOption = "lo",
    domain: DomainOption = 0,
    limit: LimitOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
) -> None:
    """Design the next experiment for what is still open, have it run, and diagnose again.

    Recordings often leave several names for what is missing. Each experiment is the safe motion
    that is expected to take these furthest apart, whatever their parameters are inside their
    intervals: it is replayed on every one of them first, and stays inside what the robot has shown
    and its model allows on each. It ends when no other name fits, intervals are as narrow as
    asked, or nothing safe would tell more. OUT/diagnosis is what wt diagnose writes, of all
    recordings, and OUT/asked.json what was asked and why. Interrupted, the same command goes on.

    Example:
        wt ask robot.xml walk1.parquet --out asked
        wt ask robot.xml --robot sim --world hidden.xml --precision 0.1 --out asked
        wt ask go2_hung.xml --robot go2 --interface eth0 --out asked
    """
    from wt.ask.loop import Wish
    from wt.cli.diagnose import printed

    _refuse(robot, world, seconds, precision)
    wish = Wish(seconds, most, precision, whole_range, seed)
    inputs = [model, *(recordings or [])]
    performers: dict[str, Callable[[], Robot]] = {
        "file": functools.partial(_person, out, wait),
        "sim": functools.partial(_simulated, world, noise, seed),
        "go2": functools.partial(_go2, out, model, interface, domain, limit or ()),
    }
    printed(_asked(inputs, out, performers[robot], wish), out / "diagnosis")


def _asked(
    inputs: Sequence[Path], out: Path, performer: Callable[[], Robot], wish: Wish
) -> Diagnosis:
    """Ask, tell every round, and write all of it; inputs are the model and recordings."""
    from rich.console import Console

    from wt.ask.loop import Experiments, Round, ask
    from wt.ask.text import print_round
    from wt.cli._progress import bar
    from wt.data import recording
    from wt.diagnose.report.write import claimed
    from wt.show.files import kept, write_whole

    rounds: list[Round] = []

    def follow(here: Round) -> None:
        rounds.append(here)
        print_round(here, len(rounds), Console())

    with kept(out), claimed(out / "diagnosis", inputs) as write:
        read = [recording.read(path) for path in inputs[1:]]
        with bar("reading") as progress:
            keep = functools.partial(_keep, out, inputs)
            experiments = Experiments(performer(), keep, progress.aside)
            answer = ask(inputs[0], read, experiments, wish, follow=follow, progress=progress)
            progress("writing", 0.98)
            write(answer.diagnosis)
            said = json.dumps(answer.to_json(), indent=2, ensure_ascii=False)
            write_whole(out / "asked.json", said + "\n")
    return answer.diagnosis


def _refuse(robot: str, world: Path | None, seconds: float, precision: float | None) -> None:
    """Refuse what cannot be asked, before any work."""
    from wt.diagnose.experiment.excite import SHORTEST_S

    if robot not in ROBOTS:
        raise UserError(f"--robot {robot!r} is unknown; {suggest(robot, ROBOTS)}")
    if (robot == "sim") != (world is not None):
        raise UserError("--robot sim and --world WORLD.xml go together; give both or neither")
    if not seconds >= SHORTEST_S:
        raise UserError(f"--seconds {seconds:g}: an experiment takes at least {SHORTEST_S:g} s")
    if precision is not None and not 0.0 < precision < 1.0:
        raise UserError(f"--precision {precision:g}: give a share between 0 and 1, 0.1 for ± 10 %")


def _person(out: Path, wait: float) -> Robot:
    from wt.ask.robot import FileRobot

    return FileRobot(out, wait, lambda line: typer.echo(line, err=True))


def _simulated(world: Path | None, noise: float, seed: int) -> Robot:
    from wt.ask.robot import SimulatedRobot

    assert world is not None  # as _refuse says
    return SimulatedRobot(world, noise, seed)


def _go2(out: Path, model: Path, interface: str, domain: int, limits: Sequence[str]) -> Robot:
    from wt.ask.robot import Go2Robot

    return Go2Robot(out, model, interface, domain, limits)


def _keep(out: Path, inputs: Sequence[Path], name: str, kept: Recording) -> None:
    from wt.ask import SOURCE
    from wt.data import recording

    path = out / f"{name}.parquet"
    recording.refuse_to_lose(path, "--out", SOURCE, inputs)
    recording.write(kept, path)
