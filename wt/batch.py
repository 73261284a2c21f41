"""``mujoco.batch`` without MuJoCo's step timer.

MuJoCo's bindings install a clock (``mjcb_time``) that every step reads several times for
``MjData.timer``. Where clocks are slow, as on virtual machines, that is a quarter of the stepping,
and nothing here reads those timers.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from pathlib import Path

import mujoco
import mujoco.batch

_LIBRARIES = ("libmujoco.so.*", "libmujoco.*.dylib", "mujoco.dll")


class Batch(mujoco.batch.Batch):
    """A ``mujoco.batch.Batch`` whose process does not time its steps.

    The clock is the process's: it is taken away when a batch is made, and stays away until
    :func:`time_steps` brings it back.
    """

    def __init__(
        self, model: mujoco.MjModel, nsim: int, nthread: int = 0, persistent: bool = False
    ) -> None:
        """As ``mujoco.batch.Batch``."""
        time_steps(False)
        super().__init__(model, nsim, nthread, persistent)


def time_steps(on: bool) -> None:
    """Have MuJoCo fill ``MjData.timer`` in this process, as it does by itself, or not.

    The results of steps are the same to the bit. Not to be switched while another thread steps.
    """
    mujoco_library = library()
    if mujoco_library is not None:
        pointer, given = _clock(mujoco_library)
        pointer.value = given if on else None


@functools.cache
def _clock(mujoco_library: ctypes.CDLL) -> tuple[ctypes.c_void_p, int | None]:
    """The address of ``mjcb_time`` and the clock that the bindings installed."""
    pointer = ctypes.c_void_p.in_dll(mujoco_library, "mjcb_time")
    return pointer, pointer.value


@functools.cache
def library() -> ctypes.CDLL | None:
    """The library that the bindings have loaded, from beside them or the environment's own."""
    for folder in (Path(mujoco.__file__).parent, Path(sys.prefix) / "lib"):
        for path in (path for pattern in _LIBRARIES for path in folder.glob(pattern)):
            return ctypes.CDLL(str(path))
    return None
