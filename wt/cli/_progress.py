"""Progress on stderr: bars where that is a terminal, elsewhere a plain line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from wt.run.study import Listener

_EVERY = 10.0
"""Seconds between two lines, and before the first: quick work says nothing."""


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
    if not console.is_terminal:
        yield Lines().say
        return
    columns = TextColumn("{task.description:<28}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(beginning, total=1.0)
        yield lambda what, share: progress.update(task, description=what, completed=share)


@contextmanager
def waiting(what: str) -> Iterator[Callable[[str], None]]:
    """A spinner over work that tells no share; yields what prints to stdout above it."""
    from rich.console import Console

    console = Console(stderr=True)
    with console.status(what):  # draws nothing where stderr is no terminal
        yield lambda text: print(text, flush=True)


class Lines:
    """Lines for a log: which step, how much of it, and since when."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin to count.

        Args:
            clock: [s].
        """
        self._clock = clock
        self._began = self._last = clock()

    def say(self, what: str, share: float) -> None:
        """Print the step and the share that is done, 0 … 1, if it is time to."""
        now = self._clock()
        if now - self._last >= _EVERY:
            self._last = now
            print(
                f"{what}: {100 * share:.0f} % after {now - self._began:.0f} s",
                file=sys.stderr,
                flush=True,
            )


class _Bars:
    """Draws; metrics are not for the terminal."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}
        self._lines = Lines() if progress.disable else None

    def progress(self, what: str, done: int, total: int) -> None:
        if self._lines is not None:
            self._lines.say(what, done / max(total, 1))
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._tasks[what], completed=done)

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        pass

    def warn(self, line: str) -> None:
        self._progress.console.print(f"warning: {line}", markup=False)
