"""What a case is drawn from."""

from __future__ import annotations

from typing import Literal

Kind = Literal["single", "pair", "triple", "outsider", "null"]
Decoy = Literal[
    "", "coarse_step", "coloured_noise", "tight_servo", "poor_excitation", "wrong_mass"
]  # fmt: skip
Row = tuple[tuple[str, ...], str, str, Kind, Decoy]
"""Effects, rig, level, kind, decoy."""

LEVELS = ("obvious", "clear", "faint")


def title(index: int, row: Row) -> str:
    """Name of the case that is drawn from a row, e.g. ``012-arm6-joint.backlash-clear``."""
    effects, rig, level, _, decoy = row
    name = f"{index:03d}-{rig}-{'+'.join(effects) or decoy or 'nothing'}"
    return f"{name}-{level}" if level else name
