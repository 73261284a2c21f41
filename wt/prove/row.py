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
