"""Machine code of laws that act at every physics step, and of the steps themselves.

In Python a law at a few places takes ten times as long as MuJoCo's step, and a call of that from
Python as long as the step of a small machine: a replay is stepped from beginning to end in one go.
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


def _stepping(
    context: Context,
    function: types.Type,
    model: types.Type,
    data: types.Type,
    landing: types.Type,
) -> tuple[Signature, Callable[..., ir.Value]]:
    """Call the step of :mod:`wt.physics.caught` by its address; the rest is given by theirs."""

    def generate(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, given: Sequence[ir.Value]
    ) -> ir.Value:
        something = ir.IntType(8).as_pointer()
        code = ir.FunctionType(ir.IntType(32), [something] * 3).as_pointer()
        parts = [builder.inttoptr(value, something) for value in given[1:]]
        return builder.call(builder.inttoptr(given[0], code), parts)

    return types.int32(function, model, data, landing), generate


_step: Any = intrinsic(_stepping)


def _advance(
    inputs: tuple[np.ndarray, float, np.ndarray, np.ndarray, np.ndarray],
    acting: tuple[np.ndarray, np.ndarray, np.ndarray],
    sides: np.ndarray,
    controls: np.ndarray,
    machine: tuple[int, int, int, int],
    state: tuple[np.ndarray, ...],
    path: np.ndarray,
) -> bool:
    """Step one replay with what acts on it, until MuJoCo warns of it; False where it went wrong.

    Args:
        inputs: time of each step, (steps,) [s]; length of a step [s]; commands, (steps, nu); forces
            beside those of laws, (steps, nv) [N·m or N]; forces and torques on all bodies, (steps,
            6 nbody or 0 for none) [N, N·m].
        acting: address of the law of each place, (places,); degree of freedom, or drives' side of
            its joint, that it acts on, (places,); addresses of its parameters and of what else is
            its own, (places, 2).
        sides: addresses of the machine's joints in qpos and qvel of the patched model, and behind
            them of their drives' sides, (2 nv,).
        controls: the command that each of its controls takes.
        machine: addresses of :mod:`wt.physics.caught`'s step, of the patched model, of its data and
            of a landing.
        state: of that data positions, velocities, controls, generalised forces, forces and torques
            on bodies, flat, and how often MuJoCo has warned of what.
        path: where it is before each step, and behind the last, (steps + 1, 2 nv): written; NaN
            behind where it has exploded.
    """
    (t, h, u, extra, wrenches), (laws, dofs, figures) = inputs, acting
    nv, steps = len(sides) // 2, len(t)
    step, model, data, landing = machine
    qpos, qvel, ctrl, applied, xfrc, warned = state
    now = np.empty((2, 2 * nv))
    q_now, v_now = now[0].ctypes.data, now[1].ctypes.data
    for k in range(steps):
        for j in range(2 * nv):
            now[0, j], now[1, j] = qpos[sides[j]], qvel[sides[j]]
            applied[sides[j]] = 0.0
        for j in range(nv):
            path[k, j], path[k, nv + j] = now[0, j], now[1, j]
            applied[sides[j]] = extra[k, j]
        for c in range(len(controls)):
            ctrl[c] = u[k, controls[c]]
        for w in range(wrenches.shape[1]):
            xfrc[w] = wrenches[k, w]
        u_now = u[k].ctypes.data
        for i in range(len(laws)):
            theta, rest = figures[i]
            force = _call(laws[i], dofs[i], q_now, v_now, u_now, t[k], h, theta, rest)
            applied[sides[dofs[i]]] += force
        if _step(step, model, data, landing) != 0:
            return False
        if warned.any():  # it has been set back, and steps from there say nothing
            path[k + 1 :] = np.nan
            return True
    for j in range(nv):
        path[steps, j], path[steps, nv + j] = qpos[sides[j]], qvel[sides[j]]
    return True


advance = fast(_advance)
