"""The specification that a case is drawn from: one line of a set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["single", "pair", "triple", "outsider", "null"]
Decoy = Literal[
    "", "coarse_step", "coloured_noise", "tight_servo", "poor_excitation", "wrong_mass"
]  # fmt: skip

LEVELS = ("obvious", "clear", "faint")


@dataclass(frozen=True)
class CaseSpec:
    """One line of a set; places, magnitudes, sensing and motions are drawn for it.

    Attributes:
        effects: ids of the effects to hide; empty for a null.
        rig: the robot, a name in ``RIGS``.
        level: size of the effects in a word; "" for a null.
        kind: single, pair, triple, outsider or null.
        decoy: feature of a null that tempts to a false claim; "" if it has none.
        asked: whether little is recorded, and the machine can be asked for more.
    """

    effects: tuple[str, ...]
    rig: str
    level: str
    kind: Kind
    decoy: Decoy = ""
    asked: bool = False

    @property
    def label(self) -> str:
        """Rig and content, e.g. ``arm6-joint.backlash``."""
        return f"{self.rig}-{'+'.join(self.effects) or self.decoy or 'nothing'}"

    def title(self, index: int) -> str:
        """Name of the case drawn from it at an index, e.g. ``012-arm6-joint.backlash-clear``."""
        name = f"{index:03d}-{self.label}"
        return f"{name}-{self.level}" if self.level else name
