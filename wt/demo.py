"""The demonstration: both halves of the package on small examples, in one folder.

What ``wt demo`` does are commands that a user could type in that folder, one process each: two
diagnoses after each other, beside them a small ``wt fit``, then the registry. Since they run in the
folder, MLflow's store, collections and runs are there too. A step whose product is there already is
not done again, so an interrupted demonstration goes on where it was.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import typing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from wt import shipped
from wt.errors import UserError, WorkError

MARK = ".wt-demo"
"""File that tells the folder of a demonstration from any other."""
DIAGNOSED = ("arm", "cart")
"""Examples that are diagnosed."""
LEFT = "go2"
"""The example that is left to the user, and how long that takes."""
LASTS = "two to ten minutes"
BASELINES = "baselines.names=[RawSim,ResDyn,MeanShiftOT,SimulatorEncoder]"
"""Of those of ``conf/debug.yaml``: the others would take a sixth of the time, and say no more."""
MODEL = "wt-debug@champion"
Say = Callable[[str], None]


@dataclass(frozen=True)
class Step:
    """One command, run in the folder.

    Attributes:
        words: the command line, as a user would type it.
        product: what it leaves, relative to the folder; it is done when this is there.
    """

    words: tuple[str, ...]
    product: str

    def __str__(self) -> str:
        """The command line."""
        return shlex.join(self.words)

    @property
    def name(self) -> str:
        """What stands before its progress: the folder of its product, else the command."""
        return (*Path(self.product).parts, self.words[1])[0]


def diagnosis_of(name: str) -> Step:
    """The command that diagnoses an example."""
    takes = (f"examples/{name}/{take}.parquet" for take in (1, 2))
    words = ("wt", "diagnose", f"examples/{name}/model.xml", *takes, "--out", name)
    return Step(words, f"{name}/report.html")


def lanes(folder: Path) -> tuple[tuple[Step, ...], ...]:
    """Steps, those of different lanes side by side: one keeps a core busy."""
    diagnoses = tuple(diagnosis_of(name) for name in DIAGNOSED)
    resume = ("--resume",) if (folder / "fit" / "config.yaml").is_file() else ()
    config = "fit/config.yaml" if resume else "debug"
    words = ("wt", "fit", "--config", config, "--out", "fit", *resume)
    fit = Step((*words, *(() if resume else ("workers=1", BASELINES))), "fit/results.json")
    return diagnoses, (fit,)


def demonstrate(folder: Path, say: Say, note: Say) -> None:
    """Do it all, and say what to open.

    Args:
        folder: new, empty, or that of an earlier demonstration.
        say: takes what is to be printed.
        note: takes lines on how far a step is.

    Raises:
        UserError: the folder holds something else, or the package came without examples.
        WorkError: a step failed.
    """
    prepare(folder)
    with ThreadPoolExecutor(2) as pool:
        for done in [pool.submit(_run_all, folder, lane, say, note) for lane in lanes(folder)]:
            done.result()
    _run(folder, Step(("wt", "registry", "show", MODEL), ""), say, note)
    say("\n".join(("", *_compared(folder), "", *_to_open(folder))))


def prepare(folder: Path) -> None:
    """Make the folder, with the examples in it.

    Raises:
        UserError: it holds something else, or the package came without examples.
    """
    given = shipped.folder("examples")
    if not (given / DIAGNOSED[0] / "model.xml").is_file():
        raise UserError(f"the examples are not installed ({given}); install the package again")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"--out: {folder} is a file; name a folder, new or empty")
    if folder.exists() and any(folder.iterdir()) and not (folder / MARK).is_file():
        raise UserError(f"--out: {folder} holds something else; name a folder, new or empty")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    for example in sorted(given.iterdir()):
        if example.is_dir() and not (folder / "examples" / example.name).exists():
            shutil.copytree(example, folder / "examples" / example.name)


def _run_all(folder: Path, steps: Sequence[Step], say: Say, note: Say) -> None:
    for step in steps:
        _run(folder, step, say, note)


def _run(folder: Path, step: Step, say: Say, note: Say) -> None:
    """Run one step unless its product is there; what it printed is said when it has ended.

    What it says of its progress, on stderr, is noted at once.

    Raises:
        WorkError: it failed.
    """
    if step.product and (folder / step.product).is_file():
        return
    words, last = [sys.executable, "-m", "wt.cli.main", *step.words[1:]], ""
    with (
        tempfile.TemporaryFile("w+") as printed,
        subprocess.Popen(
            words, cwd=folder, env=_environment(), text=True, stdout=printed, stderr=subprocess.PIPE
        ) as process,
    ):
        assert process.stderr is not None
        for line in filter(None, map(str.strip, process.stderr)):
            last = line.removeprefix("error: ")
            if last == line:
                note(f"{step.name}: {line}")
        code = process.wait()
        printed.seek(0)
        text = printed.read().rstrip()
    if code:
        raise WorkError(f"'{step}' in {folder} failed: {last or text[-200:]}")
    say(f"\n$ {step}\n{text}")


def _environment() -> dict[str, str]:
    """The user's, but for MLflow's store, which is the folder's own; one thread a process."""
    ours = {k: v for k, v in os.environ.items() if not k.startswith("MLFLOW_")}
    packages = os.pathsep.join(
        filter(None, (str(Path(__file__).parents[1]), ours.get("PYTHONPATH")))
    )
    ours |= {"PYTHONPATH": packages, "MLFLOW_DISABLE_TELEMETRY": "true", "COLUMNS": "100"}
    return {"OMP_NUM_THREADS": "1", **ours}


def _compared(folder: Path) -> list[str]:
    """What was hidden in each example, and what was said of it."""
    lines = []
    for name in DIAGNOSED:
        answer = json.loads((folder / "examples" / name / "answer.json").read_text())["truth"][0]
        findings = json.loads((folder / name / "diagnosis.json").read_text())["findings"]
        said = " ".join(f["statement"] + _sizes(f["parameters"]) for f in findings)
        said = said or "Nothing is missing."
        size = ", ".join(f"{k} {v}" for k, v in answer["parameters"].items())
        lines.append(f"{name}: hidden was {answer['effect']} at {answer['at']['name']} ({size});")
        lines.append(f"{' ' * len(name)}  said was: {said}")
    return lines


def _sizes(parameters: Mapping[str, Mapping[str, object]]) -> str:
    """Parameters of a finding, with 95 % intervals where they are single numbers."""
    sizes = []
    for name, said in parameters.items():
        if isinstance(value := said["value"], float):
            low, high = typing.cast(list[float], said["ci95"])
            sizes.append(f"{name} {value:.3g} {said['unit']}, {low:.3g} … {high:.3g}")
    return f" ({'; '.join(sizes)})" if sizes else ""


def _to_open(folder: Path) -> list[str]:
    store = f"sqlite:///{(folder / 'mlflow.db').resolve()}"
    rows = [
        *((str(folder / name / "report.html"), f"diagnosis of the {name}") for name in DIAGNOSED),
        (f"wt view {shlex.quote(str(folder / 'fit'))}", "simulation, translation and reality move"),
        (f"wt view {shlex.quote(str(folder / DIAGNOSED[0]))}", "recording and replays move"),
        (str(folder / "fit" / "results.md"), "table of single-step errors"),
        (
            f"mlflow ui --backend-store-uri {shlex.quote(store)}",
            "the run, and the registered model",
        ),
    ]
    wide = max(len(what) for what, _ in rows)
    return [
        "What to open:",
        *(f"  {what:<{wide}}  {why}" for what, why in rows),
        "",
        f"What to try, {LASTS} (examples/{LEFT}/answer.json has what is hidden):",
        f"  cd {shlex.quote(str(folder))} && {diagnosis_of(LEFT)}",
    ]
