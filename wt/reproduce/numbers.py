"""Measurements of exhibits, kept as ``numbers/<name>.json`` and found again."""

from __future__ import annotations

import json
from pathlib import Path

from wt.errors import DataError
from wt.reproduce.bench import Bench
from wt.reproduce.exhibit import Exhibit, Numbers
from wt.show.files import write_whole

FOLDER = "numbers"
SCHEMA = 3


def obtain(exhibit: Exhibit, bench: Bench) -> Numbers:
    """The numbers of an exhibit: those that are kept, or newly measured and then kept."""
    numbers = kept(exhibit, bench)
    if numbers is None:
        numbers = exhibit.measure(bench)
        content = {"schema": SCHEMA, "exhibit": exhibit.name, "found": numbers}
        content["of"] = _identity(exhibit, bench)
        path = _path(exhibit, bench)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(content, ensure_ascii=False) + "\n")
        # as they will be read: an exhibit must not rely on what JSON does not keep
        numbers = kept(exhibit, bench)
    return numbers or {}


def kept(exhibit: Exhibit, bench: Bench) -> Numbers | None:
    """The numbers that are kept; None if there are none, or those of another configuration.

    Raises:
        DataError: the file is truncated.
    """
    path = _path(exhibit, bench)
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA or content["of"] != _identity(exhibit, bench):
            return None
        numbers: Numbers = content["found"]
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path} is no result of this command ({error!r}); delete it and run again"
        ) from error
    return numbers


def _identity(exhibit: Exhibit, bench: Bench) -> str:
    """Identity of an exhibit's numbers: a change of it makes them void."""
    return " ".join([bench.identity(exhibit.tasks), exhibit.depends_on(bench)]).strip()


def _path(exhibit: Exhibit, bench: Bench) -> Path:
    return bench.out / FOLDER / f"{exhibit.name}.json"
