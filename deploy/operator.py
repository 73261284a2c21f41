"""The operator: the remote control, the keyboard, and the signals that end the program."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import numpy as np

from deploy.remote import Remote
from deploy.stages import Wish

KEYS = """keys: 1 stand up   2 policy   space damping   x end
      w/s forward/back   a/d left/right   q/e turn left/right   0 stand still
remote: L2+A stand up   start policy   L2+B damping   sticks walk and turn"""

_WISHES = {"1": Wish.STAND, "2": Wish.POLICY, " ": Wish.DAMPING, "x": Wish.QUIT, "\x1b": Wish.QUIT}
_STEP = 0.1  # of the largest command, that one key changes
_STEPS = {"w": (0, 1), "s": (0, -1), "a": (1, 1), "d": (1, -1), "q": (2, 1), "e": (2, -1)}
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def wish_of(remote: Remote) -> Wish | None:
    """Wish that the buttons express; damping comes before anything else."""
    pressed = remote.buttons
    if {"L2", "B"} <= pressed:
        return Wish.DAMPING
    if {"L2", "A"} <= pressed:
        return Wish.STAND
    return Wish.POLICY if "start" in pressed else None


class Keyboard:
    """Keys from stdin, one at a time and without Enter; from a pipe, too.

    Attributes:
        steps: what they ask for, as a share of the largest command, (3,): forward, left, turn.
    """

    def __init__(self) -> None:
        """Nothing is asked for."""
        self.steps = np.zeros(3)
        self._open = sys.stdin is not None and not sys.stdin.closed
        self._used = False

    @property
    def is_terminal(self) -> bool:
        """True if somebody sits at it."""
        return self._open and sys.stdin.isatty()

    def poll(self) -> Wish | None:
        """The last wish among the keys pressed since the last call.

        A keyboard that is gone after it was used (a terminal that closed) is a wish to end.
        """
        wish = None
        while self._open and select.select([sys.stdin], [], [], 0)[0]:
            key = os.read(sys.stdin.fileno(), 1).decode(errors="replace")
            if not key:
                self._open = False
                return Wish.QUIT if self._used else wish
            self._used = True
            if key in _STEPS:
                axis, sign = _STEPS[key]
                self.steps[axis] = np.clip(self.steps[axis] + sign * _STEP, -1, 1)
            elif key == "0":
                self.steps[:] = 0
            wish = _WISHES.get(key, wish)
        return wish


class HumanOperator:
    """Everything that an operator can use, as one."""

    def __init__(self, largest: Sequence[float]) -> None:
        """Attend to all of it.

        Args:
            largest: command of the policy, forward, left [m/s] and turning [rad/s].
        """
        self._largest = np.array(largest)
        self._keyboard = Keyboard()
        self._ended = False

    def poll(self, remote: Remote) -> tuple[Wish | None, np.ndarray]:
        """Wish and command, (3,) [m/s, m/s, rad/s], now.

        To end comes first, then damping, by whatever means it was asked for.
        """
        wishes = [self._keyboard.poll(), wish_of(remote)]
        first = (Wish.QUIT, Wish.DAMPING, *wishes)
        wish = next((w for w in first if w in wishes and w is not None), None)
        sticks = np.array([remote.forward, remote.left, remote.turn])
        share = np.clip(sticks + self._keyboard.steps, -1, 1)
        return (Wish.QUIT if self._ended else wish), share * self._largest

    def ended(self) -> bool:
        """True once a signal has asked the program to end."""
        return self._ended

    @contextmanager
    def attending(self) -> Iterator[None]:
        """Ctrl-C, SIGTERM and a terminal that closes are wishes to end; keys need no Enter."""

        def end(_signal: int, _frame: FrameType | None) -> None:
            self._ended = True

        before = [signal.signal(s, end) for s in _SIGNALS]
        terminal = termios.tcgetattr(sys.stdin) if self._keyboard.is_terminal else None
        if terminal:
            tty.setcbreak(sys.stdin)
        try:
            yield
        finally:
            if terminal:
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, terminal)
            for s, handler in zip(_SIGNALS, before, strict=True):
                signal.signal(s, handler)
