"""Progress on stderr: bars where that is a terminal, elsewhere a plain line every ten seconds."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

    from wt.run.study import Listener

_EVERY, _AT_LEAST = 10.0, 60.0
"""Seconds between two lines, and before the first: quick work says nothing; a step that takes
longer is said again after so many."""


@contextmanager
def bars() -> Iterator[Listener]:
    """A listener that draws one bar for each stage that is under way, and prints warnings."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        with Lines() as lines:
            yield _Log(lines, console)
        return
    columns = TextColumn("{task.description:<28}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console) as progress:
        yield _Bars(progress)


class Bar(Protocol):
    """How far one piece of work is."""

    def __call__(self, what: str, share: float) -> None:
        """Say the present step and the share that is done, 0 … 1."""

    def aside(self) -> AbstractContextManager[None]:
        """Nothing is said while this lasts: the terminal is somebody else's."""


@contextmanager
def bar(beginning: str, timed: bool = False) -> Iterator[Bar]:
    """One bar, drawn anew when called.

    Args:
        beginning: the first step.
        timed: whether shares are of the time that all takes, so that they say what is left of it.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        with Lines(beginning, timed=timed) as lines:
            yield lines
        return
    columns = TextColumn("{task.description:<28}"), BarColumn(), TimeElapsedColumn()
    left = [TextColumn("{task.fields[clock]}")] * timed
    with Progress(*columns, *left, console=console, transient=True) as progress:
        yield _Drawn(progress, beginning)


@contextmanager
def waiting(what: str) -> Iterator[tuple[Callable[[str], None], Callable[[str], None]]]:
    """A spinner over work that tells no share.

    Yields:
        What prints to stdout above it; and what shows a line on how far a step is: beside the
        spinner, or as a line of the log where stderr is no terminal.
    """
    from rich.console import Console
    from rich.markup import escape

    console = Console(stderr=True)
    with console.status(what) as status:  # draws nothing where stderr is no terminal

        def note(line: str) -> None:
            if console.is_terminal:
                status.update(f"{what}; {escape(line)}")
            else:
                print(line, file=sys.stderr, flush=True)

        yield lambda text: print(text, flush=True), note


class Lines:
    """Lines for a log, while the context lasts: which step, how much of it, and since when."""

    def __init__(
        self, beginning: str = "starting", every: float = _EVERY, timed: bool = False
    ) -> None:
        """Begin to count.

        Args:
            beginning: the first step.
            every: time between two lines [s].
            timed: whether shares are of the time that all takes.
        """
        self._now, self._every = (beginning, 0.0), every
        self._clock, self._timed = _Clock(), timed
        self._began, self._ended, self._aside = time.monotonic(), threading.Event(), False
        self._thread = threading.Thread(target=self._print, daemon=True)

    def __call__(self, what: str, share: float) -> None:
        """Take note of the step and the share that is done, 0 … 1."""
        self._now = (what, share)
        self._clock.say(share)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Print nothing while this lasts."""
        self._aside = True
        try:
            yield
        finally:
            self._aside = False

    def __enter__(self) -> Lines:
        """Start to print."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Print no more."""
        self._ended.set()
        self._thread.join()

    def _print(self) -> None:
        said, when, furthest = None, self._began, 0.0
        while not self._ended.wait(self._every):
            now = time.monotonic()
            if self._aside or (self._now == said and now - when < _AT_LEAST):
                continue
            said, when = self._now, now
            what, share = said
            if self._timed:  # time passes within a step too, and what was said is not taken back
                share = furthest = max(furthest, self._clock.share())
            seconds = now - self._began
            line = f"{what}: {100 * share:.0f} % after {seconds:.0f} s"
            left = f", {self._clock}" if self._timed and str(self._clock) else ""
            print(line + left, file=sys.stderr, flush=True)


class _Clock:
    """What is left, by shares of the time that all takes."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._ends, self._said = self._began, 0.0

    def say(self, share: float) -> None:
        """Take note of the share that has passed, 0 … 1."""
        now = time.monotonic()
        self._ends = self._began + (now - self._began) / share if share else now
        self._said = share

    def share(self) -> float:
        """The share that has passed by now; that which was said, where more time has than all."""
        now = time.monotonic()
        if now < self._ends:
            return max(self._said, (now - self._began) / (self._ends - self._began))
        return self._said

    def __str__(self) -> str:
        """What is left; empty where that is not known."""
        from wt.show.text import duration

        left = self._ends - time.monotonic()
        return f"about {duration(left)} to go" if left > 0.0 else ""


class _Drawn:
    """A bar on a terminal."""

    def __init__(self, progress: Progress, beginning: str) -> None:
        self._progress, self._clock = progress, _Clock()
        self._task = progress.add_task(beginning, total=1.0, clock=self._clock)

    def __call__(self, what: str, share: float) -> None:
        self._clock.say(share)
        self._progress.update(self._task, description=what, completed=share)

    @contextmanager
    def aside(self) -> Iterator[None]:
        self._progress.stop()
        try:
            yield
        finally:
            self._progress.start()


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


class _Log:
    """The listener where nothing is drawn."""

    def __init__(self, lines: Lines, console: Console) -> None:
        self._lines, self._console = lines, console
        self._under_way: dict[str, float] = {}

    def progress(self, what: str, done: int, total: int) -> None:
        self._under_way[what] = done / max(total, 1)
        going = {name: share for name, share in self._under_way.items() if share < 1.0}
        self._under_way = going or {what: 1.0}
        *beside, (last, share) = self._under_way.items()
        shares = [f"{name}: {100 * share:.0f} %" for name, share in beside]
        self._lines(", ".join([*shares, last]), share)

    def metrics(self, what: str, values: Mapping[str, float], step: int) -> None:
        pass

    def warn(self, line: str) -> None:
        self._console.print(f"warning: {line}", markup=False, soft_wrap=True)
