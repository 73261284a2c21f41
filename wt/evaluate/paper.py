"""The numbers that the paper reports, to stand beside ours."""

from __future__ import annotations

from collections.abc import Mapping

_METHODS = ("RawSim", "DirectPred", "RSSM", "ResDyn", "WorldTranslation")
SINGLE_STEP: Mapping[str, Mapping[str, float]] = {
    task: dict(zip(_METHODS, numbers, strict=True))
    for task, numbers in {
        "g1_flat": (0.030434, 0.019182, 0.006147, 0.020385, 0.007184),
        "g1_uneven": (0.052726, 0.119039, 0.070, 0.055421, 0.034837),
        "go2_flat": (0.365171, 0.349060, 0.414751, 0.441840, 0.126424),
        "go2_payload": (0.305472, 0.574078, 0.298, 0.492323, 0.147927),
        "r5_normal": (0.238427, 0.380090, 0.185424, 0.134410, 0.163895),
        "r5_force": (0.706230, 0.741280, 0.515493, 0.762682, 0.401467),
    }.items()
}
"""Single-step MSE of the next observation by task and method (figure 3), in a unit of the paper's.

It does not say which. Our best hypothesis, which no number of it confirms, is physical units over
all channels at once, where joint velocities at contact weigh most.
"""


def row(task: str) -> str | None:
    """The paper's place of a task's single-step errors; None where it has none."""
    return f"figure 3, {task}" if task in SINGLE_STEP else None


_TRANSLATED = (
    "(o, a)S, zS", "(o, a)R, zR", "(o, a)S, zS→R", "(o, a)R, zR→S", "(o, a)S, zS→R→S",
    "(o, a)R, zR→S→R",
)  # fmt: skip

HIDDEN_R2_BASELINE: Mapping[str, float] = {
    "(o, a)S": 0.73, "(o, a)R": 0.66, "(o, a, o′)S": 0.78, "(o, a, o′)R": 0.73,
}  # fmt: skip
"""R² of the external force on R5 from what is observed (table I, "Baseline")."""

HIDDEN_R2: Mapping[str, Mapping[str, float]] = {
    "w/o": dict(zip(_TRANSLATED, (0.81, 0.68, 0.67, 0.75, 0.78, 0.67), strict=True)),
    "full": dict(zip(_TRANSLATED, (0.80, 0.72, 0.68, 0.78, 0.78, 0.67), strict=True)),
}
"""R² of the external force on R5 from (o, a, z), without and with the auxiliary parts (table I)."""

DOMAIN_BASELINE: Mapping[str, float] = {"(o, a)S": 0.7894, "(o, a)R": 0.8479}
"""Accuracy of the domain on R5 from (o, a) alone (table II)."""

_FEATURES = tuple(name.partition(", z")[2] for name in _TRANSLATED)
DOMAIN: Mapping[str, Mapping[str, float]] = {
    "w/o": dict(
        zip(
            (*(f"z{name}" for name in _FEATURES), *_TRANSLATED),
            (0.6729, 0.6412, 0.4288, 0.4936, 0.7015, 0.6099,
             0.7857, 0.8326, 0.2702, 0.2404, 0.7952, 0.8227),
            strict=True,
        )
    ),
    "full": dict(
        zip(
            (*(f"z{name}" for name in _FEATURES), *_TRANSLATED),
            (0.9407, 0.9365, 0.9124, 0.8327, 0.8427, 0.9820,
             0.9443, 0.9414, 0.9070, 0.8309, 0.8459, 0.9837),
            strict=True,
        )
    ),
}  # fmt: skip
"""Accuracy of the domain on R5, without and with the auxiliary parts (table II)."""

ABLATION: Mapping[str, tuple[float, float, float]] = {
    "full": (0.034, 0.233, 0.401),
    "w/o cycle": (0.273, 0.004, 0.681),
    "w/o identity": (0.026, 0.463, 0.483),
}
"""Cycle, identity and prediction error on R5 by variant (table III)."""

DIVERGED_AT_50: Mapping[str, float] = {
    "RawSim": 0.0, "RSSM": 0.0, "WorldTranslation": 0.02, "DirectPred": 0.20,
}  # fmt: skip
"""Share of rollouts diverged after 50 steps on Go2 with payload, as the text says (figure 4)."""

LOWEST_UNTIL = 30
"""Horizon up to which World Translation has the lowest multi-step error (figure 4)."""

DOWNSTREAM: Mapping[str, tuple[float, float, float]] = {
    "none": (0.2475, 0.0517, 28.07),
    "randomization": (0.3306, 0.0694, 21.95),
    "translation": (0.1786, 0.0513, 29.55),
}
"""Tracking [rad/s], stability [rad] and power [W] of policies on a real Go2 with payload, by how
they were adapted (the table of downstream performance)."""
