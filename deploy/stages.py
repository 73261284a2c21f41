"""The stages of a run: passive → stand up → policy → damping.

The operator moves it on, never the program. Damping can be asked for at any time; from there the
robot may stand up again, unless a fault brought it there: a fault stays until the program ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Stage(Enum):
    """Stage of a run, which decides the commands of the drives.

    Attributes:
        PASSIVE: no torque.
        STAND: from where the joints are to the standing pose.
        POLICY: what the policy says.
        DAMPING: brake every joint, hold none.
    """

    PASSIVE = "passive"
    STAND = "stand"
    POLICY = "policy"
    DAMPING = "damping"


class Wish(Enum):
    """A request of the operator."""

    STAND = "stand"
    POLICY = "policy"
    DAMPING = "damping"
    QUIT = "quit"


@dataclass(frozen=True)
class Fault:
    """The reason for which the motion ended.

    Attributes:
        name: of the watchdog, e.g. ``"tilt"``.
        words: what it saw.
    """

    name: str
    words: str

    def __str__(self) -> str:
        """As in messages."""
        return f"{self.name}: {self.words}"


@dataclass(frozen=True)
class Status:
    """State of a run.

    Attributes:
        stage: what the drives are told.
        fault: what ended the motion; None as long as all is well.
    """

    stage: Stage = Stage.PASSIVE
    fault: Fault | None = None


def step(now: Status, wish: Wish | None, fault: Fault | None, stands: bool) -> Status:
    """State of the run one tick later.

    Args:
        now: where it is.
        wish: what the operator asks for; ignored where it makes no sense.
        fault: what a watchdog saw; the first one is kept.
        stands: whether the robot has stood up.
    """
    if now.fault or fault:
        return Status(Stage.DAMPING, now.fault or fault)
    if wish in (Wish.DAMPING, Wish.QUIT):
        return Status(Stage.DAMPING)
    if wish is Wish.STAND and now.stage in (Stage.PASSIVE, Stage.DAMPING):
        return Status(Stage.STAND)
    if wish is Wish.POLICY and now.stage is Stage.STAND and stands:
        return Status(Stage.POLICY)
    return now
