"""The contract of a real machine in the trials, its registry, and how to add one.

A machine is one new file in this package: a subclass of :class:`Machine` decorated with
``@register``. It says where its recordings are published, reads them, gives the MJCF of its rigid
bodies as they were published, and which motions may be learned from. Motions are fitted or held
out, never both. What its laboratory fitted to it is an MJCF too, so that it is scored by the same
replays as everything else.
"""

from __future__ import annotations

import abc
import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import mujoco

from wt.data.importers import base as importers
from wt.errors import DataError, suggest
from wt.types import Recording


class Machine(abc.ABC):
    """A real machine.

    Attributes:
        name: of its case, unique.
        folder: of its recordings, below the folder that ``--machines`` names.
        source: laboratory, publication or repository, licence.
        fit: motions to learn from.
        holdout: motions to score on.
        repeated: motions that were run again with the same commands, as ``repeats/<motion>``.
        known: what others have established about it, in one sentence; "" if nothing.
    """

    name: ClassVar[str]
    folder: ClassVar[str]
    source: ClassVar[str]
    fit: ClassVar[tuple[str, ...]]
    holdout: ClassVar[tuple[str, ...]]
    repeated: ClassVar[tuple[str, ...]] = ()
    known: ClassVar[str] = ""

    @abc.abstractmethod
    def read(self, home: Path, motion: str) -> Recording:
        """A motion, below the folder of all machines.

        Raises:
            DataError: there is no such motion, or it cannot be read.
        """

    @abc.abstractmethod
    def given(self) -> mujoco.MjSpec:
        """Rigid bodies and drives as published: what a user has before a diagnosis."""

    def published(self) -> mujoco.MjSpec | None:
        """The same with all that its laboratory fitted; None if MJCF has no words for it."""
        return None


_MACHINES: dict[str, Machine] = {}


def register(factory: type[Machine]) -> type[Machine]:
    """Class decorator: make a machine available.

    Raises:
        DataError: two files claim the same name.
    """
    machine = factory()
    if machine.name in _MACHINES:
        first = type(_MACHINES[machine.name]).__module__
        raise DataError(
            f"machine {machine.name!r} is defined by both {first} and {factory.__module__}; "
            "rename one"
        )
    _MACHINES[machine.name] = machine
    return factory


def machines() -> Mapping[str, Machine]:
    """Every machine by name, in the order of the names."""
    import wt.prove.machines

    for module in pkgutil.iter_modules(wt.prove.machines.__path__):
        importlib.import_module(f"wt.prove.machines.{module.name}")
    return dict(sorted(_MACHINES.items()))


def imported(path: Path, mapping: Mapping[str, object] | None = None) -> Recording:
    """A log as :mod:`wt.data.importers` reads it.

    Args:
        path: a file or folder of any format.
        mapping: as of ``--map``.

    Raises:
        DataError: it is missing or cannot be read.
    """
    if not path.exists():
        known = [p.name for p in path.parent.glob("*")] if path.parent.is_dir() else []
        raise DataError(f"there is no motion '{path}'; {suggest(path.name, known)}")
    return importers.read(path, mapping)


def between(recording: Recording, start: float, end: float) -> Recording:
    """The part of a recording from one time after its beginning to another [s]."""
    t = recording.t - recording.t[0]
    rows = (t >= start) & (t <= end)
    columns = {name: column[rows] for name, column in recording.columns.items()}
    return Recording(recording.t[rows], columns, recording.meta)
