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
"""Single-step MSE of the normalised next observation by task and method (figure 3)."""
