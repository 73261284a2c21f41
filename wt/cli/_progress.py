"""Progress bars on stderr, and none where stderr is no terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from wt.run.study import Listener


@contextmanager
def bars() -> Iterator[Listener]:
    """A listener that draws one bar for each stage that is under way, and prints warnings."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = TextColumn("{task.description:<28}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield _Bars(progress)


@contextmanager
def bar(beginning: str) -> Iterator[Callable[[str, float], None]]:
    """One bar, drawn anew when called with the present step and the share that is done, 0 … 1."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = TextColumn("{task.description:<28}"), BarColumn(), TimeElapsedColumn()
    shown = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with shown as progress:
        task = progress.add_task(beginning, total=1.0)
        yield lambda what, share: progress.update(task, description=what, completed=share)


class _Bars:
    """Draws; metrics are not for the terminal."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}

    def progress(self, what: str, done: int, total: int) -> None:
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._tasks[what], completed=done)

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        pass

    def warn(self, line: str) -> None:
        self._progress.console.print(f"warning: {line}", markup=False)
