"""A robot's MJCF from a file, such as a diagnosis writes: where it is, reading it, whose it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import mujoco

from wt.errors import ModelError

Needed = tuple[str, mujoco.mjtObj, Sequence[str]]
"""A kind of elements in a word and for MuJoCo, and the names that have to be there."""


def mjcf(path: Path | str) -> Path:
    """The MJCF that is named: a file, or what ``wt diagnose`` left in a folder.

    Raises:
        ModelError: there is none.
    """
    path = Path(path)
    file = path / "model.xml" if path.is_dir() else path
    if not file.is_file():
        raise ModelError(
            f"model '{file}' does not exist; name an MJCF, or the folder that wt diagnose wrote"
        )
    return file


def read(path: Path | str, change: Callable[[mujoco.MjSpec], None] | None = None) -> mujoco.MjModel:
    """Compile an MJCF.

    Args:
        path: the MJCF, or a diagnosis' folder.
        change: what is changed in it before.

    Raises:
        ModelError: there is none, or it does not compile.
    """
    path = mjcf(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if change is not None:
            change(spec)
        return spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise ModelError(f"model '{path}' is no MJCF that MuJoCo reads: {reason}") from error


def refuse(path: Path | str, robot: str, wrong: Iterator[str]) -> None:
    """Raise the first reason why a model is not one of a robot, if there is any.

    Raises:
        ModelError: it is of another robot.
    """
    for reason in wrong:
        raise ModelError(
            f"model '{mjcf(path)}' is no model of the {robot}: {reason}; give the MJCF of this "
            "robot that wt diagnose patched"
        )


def lacking(model: mujoco.MjModel, needed: Sequence[Needed]) -> Iterator[str]:
    """Elements that a model does not have, in words."""
    for kind, number, names in needed:
        for name in names:
            if mujoco.mj_name2id(model, number, name) < 0:
                yield f"it has no {kind} '{name}'"
