"""Types and shapes of our own code are checked in the first calls that a test makes of a function.

What happens at every physics step happens a hundred thousand times in a test, and its later calls
are like the first: to check each of them took a quarter of the time of all tests. What checks a
function is made when it is first called, as most are not in the tests that one process runs.
"""

from __future__ import annotations

import functools
import inspect
import types
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, ParamSpec, TypeVar, get_args, get_type_hints

import jaxtyping
from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook

FIRST = 20
"""Calls of each function that are checked in each test."""

_calls: Counter[object] = Counter()
_jaxtyped = jaxtyping.jaxtyped
_LIKE_JAXTYPING = BeartypeConf(violation_type=jaxtyping.TypeCheckError)

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
        if not inspect.isfunction(function):  # the class of a dataclass
            whole: Function[P, R] = _jaxtyped(function, typechecker=typechecker)
            return whole
        checked: Function[P, R] | None = None
        code = function.__code__  # one for all functions that a local ``def`` ever makes

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            nonlocal checked
            if _calls[code] >= FIRST:
                return function(*args, **kwargs)
            _calls[code] += 1
            if checked is None:
                checked = _checked(function, typechecker)
            return checked(*args, **kwargs)

        return call

    return decorate


def _checked(function: types.FunctionType, typechecker: Callable[..., Any]) -> Callable[..., Any]:
    """A function with its checks; where no shape is told, types alone, at half the time."""
    flags = inspect.CO_GENERATOR | inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR
    hints = {name: _hint(function, text) for name, text in function.__annotations__.items()}
    if function.__code__.co_flags & flags or any(map(_has_shape, hints.values())):
        return _jaxtyped(function, typechecker=typechecker)
    plain = types.FunctionType(
        function.__code__,
        function.__globals__,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    plain.__kwdefaults__, plain.__annotations__ = function.__kwdefaults__, hints
    plain.__module__, plain.__qualname__ = function.__module__, function.__qualname__
    checked: Callable[..., Any] = beartype(conf=_LIKE_JAXTYPING)(plain)
    return checked


def _hint(function: types.FunctionType, text: object) -> object:
    """What an annotation stands for; anything, as with jaxtyping, where it names what is local."""
    holder = types.SimpleNamespace(__annotations__={"value": text})
    try:
        return get_type_hints(holder, function.__globals__, include_extras=True)["value"]
    except Exception:
        return Any


def _has_shape(hint: object) -> bool:
    return (inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray)) or any(
        map(_has_shape, get_args(hint))
    )
