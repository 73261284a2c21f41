"""Both halves on one task: translation, diagnosis, and translation on what was diagnosed.

``wt fit`` does it where the configuration has a section ``diagnose``. What R carries and S does not
have, no translation can recover; a diagnosis of R's own walks may name it and put it into S, and
then there is something to translate. Below the folder of the run, which is of translation alone:

- ``simulator.xml``: S as it was given to the diagnosis;
- ``recordings/``: of the very walks that R's transitions for training are from;
- ``diagnosis/``: what ``wt diagnose`` leaves, with the patched ``model.xml``;
- ``patched/``: the same run on that simulator, as ``wt fit --model`` does it;
- ``joined.json``, ``joined.md``: the errors of all.

Whatever lies there from an interrupted run is used.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from wt.config import Diagnose, FitConfig
from wt.data import recording
from wt.diagnose.pipeline import diagnose
from wt.diagnose.report.write import write
from wt.errors import ConfigError
from wt.evaluate.multi_step import Step, alignment_of, of_model, roll_out, simulator
from wt.evaluate.results import OURS, PAPERS_OWN, Results
from wt.fit import fit, on_model, open_folder
from wt.run.folder import CONFIG
from wt.run.study import Listener, Study
from wt.show.files import write_together, write_whole
from wt.show.text import markdown_table, short, terminal_table
from wt.worlds.base import make
from wt.worlds.closed_loop import ClosedLoop
from wt.worlds.collect import recorded
from wt.worlds.recorded import Recorded

HORIZON = 30
"""Control steps of a rollout."""
PAST = 100
"""Control steps that R has walked before one begins: in these a load in S forgets its start."""
START_SEED = 1000
"""Seed of the starts of rollouts; the same for every method."""
RAW = "RawSim"
AS_GIVEN, PATCHED = "as given", "patched"
ROWS = (
    (AS_GIVEN, RAW, "simulator as given"),
    (AS_GIVEN, PAPERS_OWN, "translation alone, the paper's"),
    (AS_GIVEN, OURS, "translation alone, ours"),
    (PATCHED, RAW, "patched simulator"),
    (PATCHED, PAPERS_OWN, "translation on it, the paper's"),
    (PATCHED, OURS, "translation on it, ours"),
)
HEAD = ("MSE of the state", "one step", "/ as given", f"{HORIZON} steps", "diverged")
LEGEND = (
    "Normalised state of R: one step ahead under teacher forcing, and after "
    f"{HORIZON} steps on own predictions, on which the policy acts; rollouts that diverged, whose "
    "share stands last, are left out. A simulator starts from where R's trunk is; the load of the "
    "patched one has gone along with R's recorded motion until then."
)


@dataclass(frozen=True)
class Line:
    """Errors of one method on one simulator, mean over seeds.

    Attributes:
        simulator: ``"as given"`` or ``"patched"``.
        method: as in ``results.json``.
        what: the same in words.
        single_step: MSE of the normalised next state under teacher forcing.
        rollout: MSE of the normalised state after :data:`HORIZON` steps on its own predictions,
            of the rollouts that have not diverged; NaN if all have.
        diverged: share of rollouts that have left the bounds by then.
    """

    simulator: str
    method: str
    what: str
    single_step: float
    rollout: float
    diverged: float


@dataclass(frozen=True)
class Joined:
    """The outcome of all three.

    Attributes:
        task: its name.
        seeds: of training.
        lines: one a row of the table.
        diagnosis: content of ``diagnosis.json``.
    """

    task: str
    seeds: tuple[int, ...]
    lines: tuple[Line, ...]
    diagnosis: dict[str, Any]

    @property
    def ratio(self) -> float:
        """Single-step error of our best on the patched simulator, over its error alone."""
        errors = {line.simulator: line.single_step for line in self.lines if line.method == OURS}
        return errors[PATCHED] / errors[AS_GIVEN]

    def rows(self) -> list[list[str]]:
        """Cells of the table with :data:`HEAD`."""
        raw = self.lines[0].single_step
        return [
            [line.what, short(line.single_step), short(line.single_step / raw),
             short(line.rollout), f"{100 * line.diverged:.3g} %"]
            for line in self.lines
        ]  # fmt: skip

    def sentences(self) -> list[str]:
        """Sentences on the findings, and on their use."""
        statements = [f["statement"] for f in self.diagnosis["findings"]]
        return [
            *(statements or ["The diagnosis found nothing that the simulator leaves out."]),
            f"On the patched simulator, World Translation (ours) makes {self.ratio:.3g} of the "
            "error one step ahead that it makes alone.",
        ]

    def print_table(self, console: Console) -> None:
        """Print the table and the sentences."""
        console.print(terminal_table(HEAD, self.rows(), self.task))
        console.print(LEGEND, style="dim", highlight=False)
        for sentence in self.sentences():
            console.print(f"- {sentence}", highlight=False, markup=False)

    def save(self, folder: Path) -> None:
        """Write ``joined.json`` and ``joined.md``."""
        content = {
            "schema": 1,
            "task": self.task,
            "seeds": list(self.seeds),
            "horizon": HORIZON,
            "lines": [
                {**vars(x), "rollout": x.rollout if np.isfinite(x.rollout) else None}
                for x in self.lines
            ],
            "ratio": self.ratio,
            "verdict": self.diagnosis["verdict"],
            "findings": self.diagnosis["findings"],
        }
        text = [f"# {self.task}", "", *markdown_table(HEAD, self.rows()), "", LEGEND, ""]
        text += [*(f"- {sentence}" for sentence in self.sentences()), ""]
        write_together(
            folder,
            {"joined.md": "\n".join(text), "joined.json": json.dumps(content, indent=1) + "\n"},
        )


def join(config: FitConfig, folder: Path, listener: Listener) -> Joined:
    """Diagnose R, run again on the patched simulator, and compare.

    Args:
        config: with a section ``diagnose``; :func:`wt.fit.fit` has finished it in ``folder``.
        folder: the run's folder.
        listener: told of progress.

    Raises:
        ConfigError: the configuration says nothing of a diagnosis.
        WorkError: too few robots walk long enough to be recorded.
    """
    settings = config.diagnose
    if settings is None:
        raise ConfigError("there is nothing to join: the configuration has no section 'diagnose'")
    model = _diagnosed(config, settings, folder, listener)
    again = replace(
        on_model(config, model), diagnose=None, registry_name=f"{config.registry_name}-patched"
    )
    begun = folder / PATCHED
    again = open_folder(again, begun, resume=(begun / CONFIG).is_file())
    if not (begun / "results.json").is_file():
        fit(again, begun, listener)
    lines = [
        *_lines(AS_GIVEN, Study.open(config, folder, listener), settings),
        *_lines(PATCHED, Study.open(again, begun, listener), settings),
    ]
    diagnosis = json.loads((model.parent / "diagnosis.json").read_text(encoding="utf-8"))
    joined = Joined(config.task, tuple(config.seeds), tuple(lines), diagnosis)
    joined.save(folder)
    return joined


def _diagnosed(config: FitConfig, settings: Diagnose, folder: Path, listener: Listener) -> Path:
    """The patched model, of an earlier diagnosis or of a new one."""
    out = folder / "diagnosis"
    if (out / "diagnosis.json").is_file():  # the last file that is written
        return out / "model.xml"
    world = make(config.world)
    if not isinstance(world, Recorded):  # refused before anything ran
        raise TypeError(f"{config.task} cannot be recorded")
    spec = world.description("sim")
    spec.compile()
    write_whole(folder / "simulator.xml", spec.to_xml())
    paths = []
    for i, walk in enumerate(recorded(world, config.data, settings.recordings), 1):
        paths.append(folder / "recordings" / f"real_{i}.parquet")
        recording.write(walk, paths[-1])
    fitted = settings.recordings - settings.holdout

    def progress(what: str, share: float) -> None:
        listener.progress("diagnosis", round(100 * share), 100)

    diagnosis = diagnose(
        folder / "simulator.xml", paths[:fitted], paths[fitted:],
        seed=config.data.seed, progress=progress,
    )  # fmt: skip
    write(diagnosis, out)
    return out / "model.xml"


def _lines(simulated: str, study: Study, settings: Diagnose) -> list[Line]:
    """Errors of the simulator and of both translations."""
    world, config = study.world, study.config
    if not isinstance(world, ClosedLoop):  # refused before anything ran
        raise TypeError(f"{config.task} has no closed loop")
    single = Results.load(study.folder).single_step
    rolled: dict[str, list[tuple[float, float]]] = {}
    for i, seed in enumerate(config.seeds):
        study.listener.progress(f"rollouts, {simulated}", i, len(config.seeds))
        truth = world.truth(settings.rollouts, PAST, HORIZON, START_SEED + seed)
        steps: dict[str, Step] = {
            RAW: simulator,
            PAPERS_OWN: of_model(study.load_model(seed, PAPERS_OWN, config.paper)),
            OURS: of_model(study.load_model(seed, OURS, config.plus)),
        }
        for method, step in steps.items():
            alignment = alignment_of(config, method)
            rollouts = roll_out(world, truth, step, study.scales.state, alignment)
            end = float(rollouts.mse[-1]), float(rollouts.diverged[-1])
            rolled.setdefault(method, []).append(end)
    return [
        Line(simulated, method, what, single[method].mse, *_means(rolled[method]))
        for where, method, what in ROWS
        if where == simulated
    ]


def _means(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    mse, diverged = np.mean(values, axis=0)
    return float(mse), float(diverged)
