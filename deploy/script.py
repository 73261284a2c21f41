"""A scripted remote control: ``wt-sim-go2 --remote 1:stand 4:policy 5:walk=0.5 10:damping``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deploy.remote import Remote
from wt.errors import ConfigError

_PRESS = 0.2  # s that a button is held down
_BUTTONS = {
    "stand": frozenset({"L2", "A"}),
    "policy": frozenset({"start"}),
    "damping": frozenset({"L2", "B"}),
}
_FORM = "write SECONDS:stand, :policy, :damping or :walk=FORWARD,LEFT,TURN with shares of -1 … 1"


@dataclass(frozen=True)
class Script:
    """Presses and stick movements of the remote, each with its time.

    Attributes:
        presses: time [s] and buttons, in order of time.
        sticks: time [s] and forward, left, turn from then on, in order of time.
    """

    presses: tuple[tuple[float, frozenset[str]], ...] = ()
    sticks: tuple[tuple[float, tuple[float, ...]], ...] = ()

    @classmethod
    def parse(cls, words: Sequence[str]) -> Script:
        """From ``SECONDS:WHAT`` words.

        Raises:
            ConfigError: one is written otherwise.
        """
        presses, sticks = [], []
        for word in words:
            at, _, what = word.partition(":")
            name, _, values = what.partition("=")
            try:
                time, shares = float(at), [float(x) for x in values.split(",") if x]
            except ValueError:
                raise ConfigError(f"--remote {word!r}: {_FORM}") from None
            if name == "walk" and len(shares) <= 3 and all(abs(x) <= 1 for x in shares):
                sticks.append((time, tuple((*shares, 0.0, 0.0, 0.0)[:3])))
            elif name in _BUTTONS and not values:
                presses.append((time, _BUTTONS[name]))
            else:
                raise ConfigError(f"--remote {word!r}: {_FORM}")
        return cls(tuple(sorted(presses, key=lambda p: p[0])), tuple(sorted(sticks)))

    def at(self, time: float) -> Remote:
        """The remote at a time [s]."""
        pressed = [buttons for begin, buttons in self.presses if 0 <= time - begin < _PRESS]
        moved = [sticks for begin, sticks in self.sticks if begin <= time]
        return Remote(frozenset().union(*pressed), *(moved[-1] if moved else (0.0, 0.0, 0.0)))
