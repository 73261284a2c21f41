"""One class per mistake that a user can make.

Every message says what was given, what is allowed and what to do next, in one line.
``wt.cli`` turns a :class:`UserError` into that line and exit code 2, and a
:class:`WorkError` into that line and exit code 1; neither ever shows a traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class WTError(Exception):
    """Base of all errors that end a command with one line instead of a traceback."""

    exit_code = 1


class WorkError(WTError):
    """The input was fine and the work still failed (disk full, training collapsed, …)."""


class UserError(WTError):
    """The input cannot be used as it is; the message says how to change it."""

    exit_code = 2


class ConfigError(UserError):
    """A configuration file or ``key=value`` override is wrong."""


class RecordingError(UserError):
    """A recording breaks the format: names, units, time stamps or length."""


class DataError(UserError):
    """A data file is missing, truncated or of another task."""


class ModelError(UserError):
    """An MJCF or an exported model cannot be used."""


class RegistryError(UserError):
    """A registry entry is missing, or its bytes are not those that were registered."""


def lacking(what: str, package: str | None, extra: str) -> str:
    """One line on a package that is not installed.

    Args:
        what: needs it.
        package: as it is imported.
        extra: of this package, which brings it.
    """
    return (
        f"{what} needs the package '{package}', which the extra '{extra}' brings: "
        f"pip install '.[{extra}]' in a clone, or pip install 'world_translation-….whl[{extra}]'"
    )


def one_line(error: Exception) -> str:
    """An error's text without line breaks, cut to what fits a message; its kind if it has none."""
    return " ".join(str(error).split())[:300] or type(error).__name__


def suggest(given: str, allowed: Iterable[str]) -> str:
    """The nearest allowed name as '; did you mean …?', or the list of all allowed ones.

    Args:
        given: what the user wrote.
        allowed: the names that would have been accepted.
    """
    names = sorted(allowed)
    near = difflib.get_close_matches(given, names, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"allowed: {', '.join(names)}"
