"""Types and shapes of our own code are checked in the first calls that a test makes of a function.

What happens at every physics step happens a hundred thousand times in a test, and its later calls
are like the first: to check each of them took a quarter of the time of all tests. What checks a
function is made when it is first called, as most are not in the tests that one process runs.
"""

from __future__ import annotations

import functools
import inspect
from collections import Counter
from collections.abc import Callable, Iterable
from typing import ParamSpec, TypeVar

import jaxtyping
from jaxtyping import install_import_hook

FIRST = 20
"""Calls of each function that are checked in each test."""

_calls: Counter[object] = Counter()
_jaxtyped = jaxtyping.jaxtyped

P, R = ParamSpec("P"), TypeVar("R")
Function = Callable[P, R]


def check(packages: Iterable[str]) -> None:
    """Have functions and dataclasses of packages checked, which are to be imported after this."""
    jaxtyping.jaxtyped = _checked_at_first  # what the hook decorates with
    install_import_hook(sorted(packages), "beartype.beartype")


def anew() -> None:
    """Check the next calls of each function, whatever was called before."""
    _calls.clear()


def _checked_at_first(
    *, typechecker: Callable[..., object]
) -> Callable[[Function[P, R]], Function[P, R]]:
    def decorate(function: Function[P, R]) -> Function[P, R]:
        def checks() -> Function[P, R]:
            made: Function[P, R] = _jaxtyped(function, typechecker=typechecker)
            return made

        if not inspect.isfunction(function):  # the class of a dataclass
            return checks()
        checked: Function[P, R] | None = None
        code = function.__code__  # one for all functions that a local ``def`` ever makes

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            nonlocal checked
            if _calls[code] >= FIRST:
                return function(*args, **kwargs)
            _calls[code] += 1
            if checked is None:
                checked = checks()
            return checked(*args, **kwargs)

        return call

    return decorate
