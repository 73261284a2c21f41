"""``mujoco.batch`` without MuJoCo's step timer.

MuJoCo's bindings install a clock (``mjcb_time``) that every step reads several times for
``MjData.timer``. Where clocks are slow, as on virtual machines, that is a quarter of the stepping,
and nothing here reads those timers.
"""

from __future__ import annotations

import ctypes
import functools
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
    clock = _clock()
    if clock is not None:
        pointer, given = clock
        pointer.value = given if on else None


@functools.cache
def _clock() -> tuple[ctypes.c_void_p, int | None] | None:
    """The address of ``mjcb_time`` and the clock that the bindings installed; None if not found."""
    folder = Path(mujoco.__file__).parent
    for pattern in _LIBRARIES:
        for path in folder.glob(pattern):
            pointer = ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_time")
            return pointer, pointer.value
    return None
