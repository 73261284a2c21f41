"""Faults between a robot and a runner, made on purpose: ``wt-sim-go2 --fault``."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from deploy import go2
from deploy.messages import Packed
from wt.errors import ConfigError, suggest

Kind = Literal["drop", "delay", "nan", "flip"]

_DELAY = 0.1  # s
_MOTOR = go2.JOINTS.index("FL_calf_joint")


@dataclass
class Mischief:
    """From some time on, states of the robot are not what they should be.

    Attributes:
        kind: ``drop``: none arrives; ``delay``: each arrives 0.1 s late; ``nan``: a joint's
            position is no number; ``flip``: a joint's position and velocity have the wrong sign.
        begin: when it begins [s].
    """

    kind: Kind
    begin: float
    _held: deque[tuple[float, Packed]] = field(default_factory=deque, repr=False)

    @classmethod
    def parse(cls, text: str) -> Mischief:
        """From ``KIND@SECONDS``.

        Raises:
            ConfigError: it is written otherwise, or there is no such kind.
        """
        kind, _, seconds = text.partition("@")
        known = get_args(Kind)
        if kind not in known:
            raise ConfigError(
                f"--fault {text!r}: no fault is called {kind!r}; {suggest(kind, known)}"
            )
        try:
            begin = float(seconds)
        except ValueError:
            raise ConfigError(f"--fault {text!r}: write when it begins, e.g. {kind}@6") from None
        return cls(kind, begin)  # type: ignore[arg-type]

    def pass_on(self, message: Packed, time: float) -> Iterator[Packed]:
        """Messages that arrive once a state was sent at ``time`` [s]: its own, or earlier ones."""
        if time < self.begin:
            yield message
        elif self.kind == "delay":
            self._held.append((time, message))
            while self._held and self._held[0][0] <= time - _DELAY:
                yield self._held.popleft()[1]
        elif self.kind != "drop":
            drive = message.data["motor_state"][_MOTOR]
            drive["q"] = np.nan if self.kind == "nan" else -drive["q"]
            drive["dq"] = drive["dq"] if self.kind == "nan" else -drive["dq"]
            yield message.seal()
