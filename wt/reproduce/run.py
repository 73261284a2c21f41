"""``wt reproduce`` as a whole: measure what is asked for, report all that is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from wt.errors import WorkError
from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, exhibits
from wt.reproduce.numbers import kept, obtain
from wt.reproduce.report import Entry, write
from wt.reproduce.tasks import FULL, QUICK, PaperTask, chosen
from wt.run.study import Listener

Bars = Callable[[], AbstractContextManager[Listener]]
Say = Callable[[Entry], None]
"""Called with each exhibit that was asked for as soon as it is measured."""


def reproduce(
    conf: Path,
    out: Path,
    *,
    only: Sequence[str],
    tasks: Sequence[str],
    overrides: Sequence[str],
    quick: bool,
    bars: Bars,
    say: Say,
) -> Path:
    """Measure exhibits, and write the report of all whose numbers are there.

    Args:
        conf: folder of the configurations.
        out: folder of the report and of the runs.
        only: names of exhibits; none for all.
        tasks: names of tasks; none for all. Exhibits that need others are left out.
        overrides: ``key=value`` words on top of the configurations.
        quick: small models and little data.
        bars: makes the listener of one exhibit.
        say: see :data:`Say`.

    Returns:
        The path of the report's page.

    Raises:
        ConfigError: a name is not known, or a configuration cannot be run.
        WorkError: an exhibit failed; the report holds the others.
    """
    wanted = {exhibit.name for exhibit in exhibits(only)}
    there, left_out = chosen(tasks, conf)
    words = [*(QUICK if quick else FULL), *overrides]
    names = [task.name for task in there]
    entries, failed = [], []
    with bars() as listener:
        bench = Bench(conf, out, there, words, quick, listener)
        for name in names:
            bench.config(name)  # a wrong override is said before anything runs
    for exhibit in exhibits():
        if exhibit.name not in wanted or not exhibit.can_run(names):
            entries.append(_known(exhibit, bench, names))
            continue
        try:
            with bars() as listener:
                numbers = obtain(exhibit, replace(bench, listener=listener))
        except WorkError as error:  # the others do not depend on it
            failed.append(f"{exhibit.name}: {error}")
            entries.append(Entry(exhibit, None, str(error)))
            continue
        entries.append(Entry(exhibit, exhibit.present(numbers)))
        say(entries[-1])
    page = write(out, entries, _about(there, left_out, words, quick))
    if failed:
        raise WorkError(
            f"{page} lacks {len(failed)} of {len(wanted)} exhibits; {'; '.join(failed)}"
        )
    return page


def _known(exhibit: Exhibit, bench: Bench, names: Sequence[str]) -> Entry:
    """Entry of an exhibit that was not asked for: earlier numbers, or why there are none."""
    if not exhibit.can_run(names):
        missing = ", ".join(task for task in exhibit.tasks if task not in names)
        return Entry(exhibit, None, f"it needs {missing}, not chosen or without a configuration")
    numbers = kept(exhibit, bench)
    if numbers is None:
        return Entry(exhibit, None, f"wt reproduce --only {exhibit.name} does it")
    return Entry(exhibit, exhibit.present(numbers))


def _about(
    tasks: Sequence[PaperTask], left_out: Sequence[PaperTask], words: Sequence[str], quick: bool
) -> str:
    size = "Small models and little data: shows that it runs, not how well. " if quick else ""
    seeds = next((word.partition("=")[2] for word in reversed(words) if "seeds=" in word), "[0]")
    missing = ", ".join(task.name for task in left_out)
    rest = f" Without a configuration: {missing}." if missing else ""
    return f"{size}Tasks {', '.join(task.name for task in tasks)}; seeds {seeds}.{rest}"
