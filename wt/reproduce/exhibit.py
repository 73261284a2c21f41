"""The contract of an exhibit (a table or figure of the report), its registry, and how to add one.

Adding an exhibit is one new file in ``wt/reproduce/exhibits`` (and its test): subclass
:class:`Exhibit`, set ``name``, ``order``, ``title`` and ``tasks``, write ``measure`` and
``present``, decorate with ``@register``. It is found by itself.

``measure`` works: it trains what it needs through the :class:`wt.reproduce.bench.Bench`, which
finds again whatever is already trained, and returns plain numbers. They are kept as
``<name>.json``. ``present`` only turns such numbers into tables, figures and sentences, so that a
report can be put together again without any work. Neither holds a number of the paper's: those
are in :mod:`wt.evaluate.paper`.
"""

from __future__ import annotations

import importlib
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import wt.reproduce.exhibits
from wt.errors import ConfigError, suggest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from wt.reproduce.bench import Bench

Numbers = dict[str, Any]
"""Measurements of an exhibit: nested dictionaries and lists of numbers and text, fit for JSON."""


@dataclass(frozen=True)
class Grid:
    """One table.

    Attributes:
        head: its columns.
        rows: cells of each row.
        caption: what stands under it; empty for nothing.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """One exhibit in the report.

    Attributes:
        text: what was measured and how, one paragraph.
        grids: tables, the paper's numbers beside ours.
        figures: by file name without suffix.
        differences: a line on each difference from the paper, or on what was gained.
    """

    text: str
    grids: Sequence[Grid] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    differences: Sequence[str] = ()


class Exhibit(ABC):
    """One table or figure.

    Attributes:
        name: as in ``--only`` and of its files, e.g. ``"table-1"``.
        order: place in the report.
        title: its heading.
        tasks: the paper's tasks that it needs, by name.
        any_task: whether one of them is enough.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    title: ClassVar[str]
    tasks: ClassVar[tuple[str, ...]]
    any_task: ClassVar[bool] = False

    @abstractmethod
    def measure(self, bench: Bench) -> Numbers:
        """Train what is not yet trained, and measure."""

    @abstractmethod
    def present(self, numbers: Numbers) -> Section:
        """Turn what :meth:`measure` returned into a section of the report."""

    def depends_on(self, bench: Bench) -> str:
        """Anything but the tasks' configurations that decides the numbers; they are kept for it."""
        return ""

    def can_run(self, tasks: Sequence[str]) -> bool:
        """True if these tasks are enough."""
        there = [task in tasks for task in self.tasks]
        return any(there) if self.any_task else all(there)


_EXHIBITS: dict[str, type[Exhibit]] = {}


def register(exhibit: type[Exhibit]) -> type[Exhibit]:
    """Class decorator: make an exhibit available under its ``name``.

    Raises:
        ConfigError: two files claim the same name.
    """
    if exhibit.name in _EXHIBITS:
        raise ConfigError(
            f"exhibit {exhibit.name!r} is defined by both "
            f"{_EXHIBITS[exhibit.name].__module__} and {exhibit.__module__}; rename one"
        )
    _EXHIBITS[exhibit.name] = exhibit
    return exhibit


def exhibits(names: Sequence[str] = ()) -> list[Exhibit]:
    """The exhibits of these names, or all, in the report's order.

    Raises:
        ConfigError: a name is of none.
    """
    for module in pkgutil.iter_modules(wt.reproduce.exhibits.__path__):
        importlib.import_module(f"wt.reproduce.exhibits.{module.name}")
    for name in names:
        if name not in _EXHIBITS:
            raise ConfigError(f"--only {name!r} is no exhibit: {suggest(name, _EXHIBITS)}")
    wanted = [kind() for name, kind in _EXHIBITS.items() if not names or name in names]
    return sorted(wanted, key=lambda exhibit: exhibit.order)
