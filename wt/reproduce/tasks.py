"""The paper's six tasks: which configuration makes each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wt.errors import ConfigError, suggest


@dataclass(frozen=True)
class PaperTask:
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
    PaperTask("g1_flat", "G1 humanoid", "flat", "g1_flat.yaml"),
    PaperTask("g1_uneven", "G1 humanoid", "uneven", "g1_uneven.yaml"),
    PaperTask("go2_flat", "Go2 quadruped", "flat", "go2_flat.yaml"),
    PaperTask("go2_payload", "Go2 quadruped", "payload", "go2_payload.yaml"),
    PaperTask("r5_normal", "R5 manipulator", "normal", "r5_normal.yaml"),
    PaperTask("r5_force", "R5 manipulator", "force", "r5.yaml"),
)
"""In the order of the paper's figure 3: of each robot what is hidden little, then much."""

WALKING = tuple(task.name for task in TASKS if task.config.startswith(("g1", "go2")))
"""Names of those with a robot on legs."""

FULL = ("seeds=[0,1,2]",)
"""Overrides of a full run: the spread needs several seeds."""

QUICK = (
    "seeds=[0]",
    "data.transitions=8000", "data.validation_pairs=1000", "data.test_pairs=1000",
    *(f"{who}.{key}" for who in ("paper", "plus") for key in (
        "mean.steps=300", "mean.width=64", "nets.width=64", "nets.translator_width=64",
        "train.steps=300", "train.batch=256", "train.validate_every=100",
    )),
    "baselines.width=64", "baselines.steps=300", "baselines.batch=256",
)  # fmt: skip
"""Overrides that make a task run through in a minute or two; its numbers only show that it runs."""


def chosen(names: Sequence[str], conf: Path) -> tuple[list[PaperTask], list[PaperTask]]:
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
