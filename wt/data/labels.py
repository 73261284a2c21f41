"""Which machine a recording is of, when it was taken, and what the machine carried.

Three entries of a recording's metadata: ``unit`` is one machine of its model, ``session`` the day
(and, where there are several in a day, the time) on which it was set up and run, ``load`` what was
mounted on it. Everything recorded under the same three belongs together.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping
from dataclasses import dataclass

from wt.errors import RecordingError, UserError

UNLOADED = "none"
"""The load of a machine that carries nothing; recordings that name no load are of such a one."""
_NAME = re.compile(r"[\w+][\w.+-]{0,63}")
_SESSION = re.compile(r"\d{4}-\d{2}-\d{2}(T\d{2}:\d{2})?")
_DAY_S = 86400.0


@dataclass(frozen=True, order=True)
class Labels:
    """Labels of a recording.

    Attributes:
        unit: name of the machine, e.g. ``"A17"``.
        session: ``YYYY-MM-DD`` or ``YYYY-MM-DDTHH:MM``.
        load: name of what it carried.
    """

    unit: str
    session: str
    load: str = UNLOADED

    def __str__(self) -> str:
        """As in messages."""
        carried = "" if self.load == UNLOADED else f" with {self.load}"
        return f"{self.unit} on {self.session}{carried}"

    @property
    def day(self) -> float:
        """Days since the first day of the calendar; differences are what matters."""
        return day(self.session)


def day(session: str) -> float:
    """The time of a session [days since the first day of the calendar].

    Args:
        session: as in :class:`Labels`.
    """
    when = datetime.datetime.fromisoformat(session)
    return when.toordinal() + (3600.0 * when.hour + 60.0 * when.minute) / _DAY_S


def checked(
    unit: str | None = None, session: str | None = None, load: str | None = None
) -> dict[str, str]:
    """Entries of the metadata for those labels that are given.

    Raises:
        UserError: one of them is no name, or no date.
    """
    given = {"unit": unit, "session": session, "load": load}
    for key in ("unit", "load"):
        name = given[key]
        if name is not None and not _NAME.fullmatch(name):
            raise UserError(
                f"--{key} {name!r} is no name; use letters, digits, '_', '.', '+' and '-', at most "
                "64 of them and no '.' or '-' first, as in A17"
            )
    if session is not None and not _is_session(session):
        raise UserError(
            f"--session {session!r} is no date; write YYYY-MM-DD, or YYYY-MM-DDTHH:MM where there "
            "are several in a day, as in 2026-11-25"
        )
    return {key: value for key, value in given.items() if value is not None}


def labels_of(meta: Mapping[str, object], name: str) -> Labels:
    """The labels in a recording's metadata.

    Args:
        meta: the metadata.
        name: of the recording, for messages.

    Raises:
        RecordingError: it names no unit or no session, or one that is no such name.
    """
    found = {key: meta[key] for key in ("unit", "session", "load") if meta.get(key) is not None}
    missing = [key for key in ("unit", "session") if key not in found]
    again = f"wt import {name} --to OUT.parquet --unit A17 --session 2026-11-25"
    if missing:
        raise RecordingError(f"'{name}' names no {' and no '.join(missing)}; add them: {again}")
    try:
        labels = checked(**{key: str(value) for key, value in found.items()})
    except UserError as error:
        raise RecordingError(f"metadata of '{name}': {error}; mend it: {again}") from error
    return Labels(**labels)


def _is_session(text: str) -> bool:
    if not _SESSION.fullmatch(text):
        return False
    try:
        day(text)
    except ValueError:  # of a shape that fits, and no day of any calendar
        return False
    return True
