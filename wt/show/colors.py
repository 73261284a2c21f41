"""One colour a method, the same in every figure and recording.

From the palettes of Okabe and Ito (2008) and Tol (2021): distinguishable with any colour vision,
and on a white page as well as on a dark screen.
"""

from __future__ import annotations

Color = tuple[int, int, int]

S: Color = (86, 180, 233)
TRANSLATED: Color = (230, 159, 0)
R: Color = (0, 158, 115)

_METHODS: dict[str, Color] = {
    "WorldTranslationPlus": (213, 94, 0),
    "WorldTranslation": (230, 159, 0),
    "RawSim": (140, 140, 140),
    "DirectPred": (86, 180, 233),
    "ResDyn": (0, 114, 178),
    "ResDynSim": (204, 121, 167),
    "RSSM": (187, 170, 51),
    "MeanShiftOT": (136, 84, 52),
    "DeltaAction": (102, 37, 6),
    "FlowTranslation": (170, 68, 153),
    "SimulatorEncoder": (0, 0, 0),
    "PairedCeiling": (17, 119, 51),
}


def of_method(method: str) -> Color:
    """RGB of a method, 0–255; a dark grey for one that has no colour of its own."""
    return _METHODS.get(method, (90, 90, 90))


SERIES: tuple[Color, ...] = (
    (0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (213, 94, 0), (86, 180, 233),
)  # fmt: skip
"""For lines that are no methods, in this order."""

BEFORE: Color = (213, 94, 0)
AFTER: Color = (0, 114, 178)
"""Simulation with the model as it was given, and with the patched one."""
