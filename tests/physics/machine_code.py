"""Calls the machine code of a law, as compiled replays do."""

from __future__ import annotations

import ctypes

import numpy as np

from wt.physics.compiled import address
from wt.physics.live import Live

_LAW = ctypes.CFUNCTYPE(
    ctypes.c_double,
    ctypes.c_ssize_t,
    *[ctypes.c_void_p] * 3,
    *[ctypes.c_double] * 2,
    *[ctypes.c_void_p] * 2,
)


def called(law: Live, q: np.ndarray, v: np.ndarray, u: np.ndarray, t: float, h: float) -> float:
    """Force of a law at its first place in a state of all joints."""
    tables = law.theta[0], law.own[0]
    states = [np.ascontiguousarray(x) for x in (np.tile(q, 2), np.tile(v, 2), u)]  # no rotor
    pointers = [x.ctypes.data for x in (*states, *tables)]
    force = _LAW(address(law.law))(int(law.dofs[0]), *pointers[:3], t, h, *pointers[3:])
    return float(force)
