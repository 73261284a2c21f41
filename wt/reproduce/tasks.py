"""The paper's six tasks: which configuration makes each, and the run of it in a folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from wt.config import load
from wt.errors import ConfigError, suggest
from wt.evaluate.results import Results
from wt.fit import CONFIG, fit, open_folder
from wt.study import Listener

Report = Callable[[str], None]
"""Called with one line on what is being done."""


@dataclass(frozen=True)
class Task:
    """One task of the paper.

    Attributes:
        name: as in the results, e.g. ``"r5_force"``.
        robot: as the paper calls it.
        condition: what is hidden, in a word or two.
        config: file in ``conf/``.
    """

    name: str
    robot: str
    condition: str
    config: str


TASKS = (
    Task("g1_flat", "G1 humanoid", "flat", "g1_flat.yaml"),
    Task("g1_uneven", "G1 humanoid", "uneven", "g1_uneven.yaml"),
    Task("go2_flat", "Go2 quadruped", "flat", "go2_flat.yaml"),
    Task("go2_payload", "Go2 quadruped", "payload", "go2_payload.yaml"),
    Task("r5_normal", "R5 manipulator", "normal", "r5_normal.yaml"),
    Task("r5_force", "R5 manipulator", "force", "r5.yaml"),
)
"""In the order of the paper's figure 3: of each robot what is hidden little, then much."""

QUICK = (
    "data.transitions=8000", "data.validation_pairs=1000", "data.test_pairs=1000",
    *(f"{who}.{key}" for who in ("paper", "plus") for key in (
        "mean.steps=300", "mean.width=64", "nets.width=64", "nets.translator_width=64",
        "train.steps=300", "train.batch=256", "train.validate_every=100",
    )),
    "baselines.width=64", "baselines.steps=300", "baselines.batch=256",
)  # fmt: skip
"""Overrides that make a task run through in a minute or two; its numbers only show that it runs."""


def chosen(names: Sequence[str], conf: Path) -> tuple[list[Task], list[Task]]:
    """The tasks with these names, or all: those whose configuration is there, and the others.

    Args:
        names: of tasks; none for all.
        conf: folder of the configurations.

    Raises:
        ConfigError: a name is of no task, or no configuration is there.
    """
    known = {task.name: task for task in TASKS}
    for name in names:
        if name not in known:
            raise ConfigError(f"--task {name!r} is no task of the paper: {suggest(name, known)}")
    wanted = [task for task in TASKS if task.name in (names or known)]
    there = [task for task in wanted if (conf / task.config).is_file()]
    if not there:
        files = ", ".join(task.config for task in wanted)
        raise ConfigError(f"--conf {conf} holds none of {files}; name the folder that does")
    return there, [task for task in wanted if task not in there]


def run(
    task: Task, conf: Path, folder: Path, overrides: Sequence[str], listen: Listener
) -> Results:
    """The results of a task: those that lie in the folder, or of its run, begun or continued.

    Args:
        task: what is run.
        conf: folder of the configurations.
        folder: of the run.
        overrides: ``key=value`` words on top of the configuration.
        listen: told of progress and warnings.

    Raises:
        ConfigError: the folder holds a run of another configuration.
    """
    begun = (folder / CONFIG).is_file()
    settings = open_folder(load(conf / task.config, overrides), folder, resume=begun)
    if not (folder / "results.json").is_file():
        fit(settings, folder, listen)
    return Results.load(folder)
