"""Machine code of laws that act at every physics step, and of what is done between two steps.

In Python a law at a few places takes ten times as long as MuJoCo's step.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import threading
import types as python
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import cfunc, njit, types
from numba.core.base import BaseContext
from numba.core.typing import Context
from numba.core.typing.templates import Signature
from numba.extending import intrinsic, overload

from wt.physics.live import Acts, Law, callable_in_laws

_FIGURES = types.CPointer(types.float64)
_LAW = types.float64(
    types.intp, _FIGURES, _FIGURES, _FIGURES, types.float64, types.float64, _FIGURES, _FIGURES
)
_one_at_a_time = threading.Lock()
_compiled: dict[Law, Any] = {}
_known: set[Callable[..., object]] = set()


def address(law: Law) -> int:
    """Where the machine code of a law begins, which stays there as long as the process lives."""
    with _one_at_a_time:
        for function in callable_in_laws:
            if function not in _known:
                _known.add(function)
                _make_known(function)
        if law not in _compiled:
            compiler = functools.partial(cfunc, _LAW, error_model="numpy")
            _compiled[law] = _kept(compiler, _of_this_version(law.acts))
    return int(_compiled[law].address)


def fast(function: Callable[..., object]) -> Any:  # noqa: ANN401 – Numba's
    """A function that is compiled when it is first called."""
    return _kept(functools.partial(njit, nogil=True), inspect.unwrap(function))


def _kept(compiler: Callable[..., Any], function: Callable[..., object]) -> Any:  # noqa: ANN401
    """What a compiler makes of a function, kept on the disk where anything can be written."""
    try:
        return compiler(cache=True)(function)
    except RuntimeError:  # Numba found no folder
        return compiler()(function)


def _make_known(function: Callable[..., object]) -> None:
    """Have Numba compile a function where compiled code calls it."""
    plain = inspect.unwrap(function)
    overload(function, strict=False)(lambda *_, **__: plain)


def _of_this_version(acts: Acts) -> python.FunctionType:
    """A law under a name of its own for each version of what it calls.

    Numba takes what it has kept for as long as the law's own file is the same.
    """
    plain = inspect.unwrap(acts)
    assert isinstance(plain, python.FunctionType)
    named = python.FunctionType(plain.__code__, plain.__globals__, plain.__name__)
    named.__qualname__ = f"{plain.__qualname__}-{_version(plain)}"
    named.__module__ = plain.__module__
    return named


def _version(function: python.FunctionType) -> str:
    """Of the files of all that a function calls, and of this one."""
    reached = [function]
    for now in reached:  # grows
        called = [now.__globals__.get(name) for name in now.__code__.co_names]
        plain = [inspect.unwrap(f) for f in called if f in callable_in_laws]
        reached += [f for f in plain if f not in reached]
    files = {__file__, *(f.__code__.co_filename for f in reached)}
    return hashlib.sha256(b"".join(Path(f).read_bytes() for f in sorted(files))).hexdigest()[:8]


def _calling(
    context: Context,
    law: types.Type,
    dof: types.Type,
    q: types.Type,
    v: types.Type,
    u: types.Type,
    t: types.Type,
    h: types.Type,
    theta: types.Type,
    own: types.Type,
) -> tuple[Signature, Callable[..., ir.Value]]:
    """Call a law by its address; arrays are given by theirs."""
    number = types.float64
    passed = (dof, q, v, u, number, number, theta, own)

    def generate(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, given: Sequence[ir.Value]
    ) -> ir.Value:
        figure = ir.DoubleType()
        figures = figure.as_pointer()
        kinds = [given[1].type, figures, figures, figures, figure, figure, figures, figures]
        code = ir.FunctionType(figure, kinds).as_pointer()
        values = [
            builder.inttoptr(value, kind) if kind is figures else value
            for value, kind in zip(given[1:], kinds, strict=True)
        ]
        return builder.call(builder.inttoptr(given[0], code), values)

    return number(law, *passed), generate


_call: Any = intrinsic(_calling)


def _turn(
    k: int,
    t: np.ndarray,
    h: float,
    u: np.ndarray,
    extra: np.ndarray,
    own: np.ndarray,
    controls: np.ndarray,
    laws: np.ndarray,
    places: np.ndarray,
    figures: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray,
    path: np.ndarray,
    ctrl: np.ndarray,
    applied: np.ndarray,
) -> None:
    """Before a physics step: note where n replays are, and set what acts on them.

    Args:
        k: the step.
        t: time of each step, (steps, n) [s].
        h: length of a step [s].
        u: commands, (steps, n, nu).
        extra: forces beside those of laws, (steps, n, nv) [N·m or N].
        own: addresses of the machine's joints in qpos and qvel, (nv,).
        controls: the command that each control of the patched models takes.
        laws: address of the law of each place, (places,).
        places: replay and degree of freedom of each, (places, 2).
        figures: address of the parameters, and of what else is its own, of each, (places, 2).
        qpos: positions now, (n, ·), of the patched models.
        qvel: velocities.
        path: where each replay is before each step, (steps, n, 2 nv): row k is written.
        ctrl: written, (n, controls).
        applied: generalised forces, written for the machine's joints, (n, ·).
    """
    n, nv = qpos.shape[0], len(own)
    for r in range(n):
        for j in range(nv):
            path[k, r, j], path[k, r, nv + j] = qpos[r, own[j]], qvel[r, own[j]]
            applied[r, own[j]] = extra[k, r, j]
        for c in range(len(controls)):
            ctrl[r, c] = u[k, r, controls[c]]
    states, commands = path[k].ctypes.data, u[k].ctypes.data
    for i in range(len(laws)):
        r, dof = places[i]
        q, command = states + r * path.strides[1], commands + r * u.strides[1]
        v = q + nv * path.strides[2]
        applied[r, own[dof]] += _call(
            laws[i], dof, q, v, command, t[k, r], h, figures[i, 0], figures[i, 1]
        )


turn = fast(_turn)
