"""Motions of the robots on legs: positions over time that their servos are sent.

All start from standing still. What the trunk and the feet should do is drawn, and inverse
kinematics turn it into angles; no feedback corrects the outcome, so that the commands reveal
nothing that is hidden. Their sizes keep both robots upright with any hidden effect.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from wt.prove import gaits, legs
from wt.prove import legged_rigs as rigs
from wt.prove.legged_rigs import Legged
from wt.prove.motions import SHAPES

MOTIONS: dict[str, tuple[str, ...]] = {
    "quadruped": ("sway", "squat", "twist", "paw", "trot", "walk"),
    "humanoid": ("sway", "squat", "twist", "swing", "shift"),
}
RAMP_S = 1.0
"""Time in which a motion grows from standing [s]."""

# Of the trunk: shape and size of x, y, z [m], roll, pitch, yaw [rad]
_Sway = tuple[tuple[str, float], ...]
_STILL: _Sway = (("multisine", 0.01),) * 3 + (("multisine", 0.03),) * 3
_TRUNK: dict[str, dict[str, _Sway]] = {
    "quadruped": {
        "sway": (("multisine", 0.04), ("multisine", 0.035), ("multisine", 0.035),
                 ("multisine", 0.12), ("multisine", 0.12), ("multisine", 0.22)),
        "squat": (("holds", 0.03), ("holds", 0.03), ("moves", 0.07),
                  ("moves", 0.06), ("moves", 0.1), ("multisine", 0.05)),
        "twist": (("triangle", 0.03), ("triangle", 0.03), ("multisine", 0.02),
                  ("chirp", 0.13), ("triangle", 0.12), ("chirp", 0.25)),
        "paw": _STILL, "trot": _STILL, "walk": _STILL,
    },
    "humanoid": {
        "sway": (("multisine", 0.015), ("multisine", 0.03), ("multisine", 0.03),
                 ("multisine", 0.05), ("multisine", 0.05), ("multisine", 0.2)),
        "squat": (("multisine", 0.012), ("multisine", 0.02), ("moves", 0.07),
                  ("multisine", 0.03), ("moves", 0.08), ("multisine", 0.05)),
        "twist": (("triangle", 0.02), ("triangle", 0.025), ("triangle", 0.03),
                  ("triangle", 0.05), ("triangle", 0.05), ("triangle", 0.25)),
        "swing": (("multisine", 0.01), ("multisine", 0.012), ("multisine", 0.015),
                  ("multisine", 0.02), ("multisine", 0.02), ("multisine", 0.06)),
        "shift": (("holds", 0.012), ("holds", 0.045), ("holds", 0.025),
                  ("moves", 0.03), ("moves", 0.04), ("moves", 0.1)),
    },
}  # fmt: skip
_LOWER = {"quadruped": 0.01, "humanoid": 0.035}
"""Mean height of the trunk below standing, so that it can rise [m]."""
_ASTRIDE = 0.025
"""Distance of a quadruped's feet outside of its hips [m]."""
_FORWARD = {"quadruped": 0.02, "humanoid": 0.02}
"""Place of the trunk in front of standing, so that its weight is over the feet's middle [m]."""
_UPPER: dict[str, tuple[str, float]] = {
    "sway": ("multisine", 0.5), "squat": ("moves", 0.4), "twist": ("triangle", 0.6),
    "swing": ("multisine", 1.0), "shift": ("moves", 0.5),
}  # fmt: skip
"""Motion of waist and arms meanwhile: shape, and share of their amplitude."""


def reference(
    rig: Legged, kind: str, t: Float[np.ndarray, " sample"], calm: float, rng: np.random.Generator
) -> Float[np.ndarray, "sample joint"]:
    """Commands of one motion.

    Args:
        rig: the robot.
        kind: one of its ``MOTIONS``.
        t: times [s]; the robot stands at 0 and before.
        calm: share of the usual size, at most 1.
        rng: decides all that is free.

    Returns:
        Positions of the joints [rad].
    """
    sizes = _TRUNK[rig.name][kind]
    unit = np.stack([SHAPES[shape](t * rig.tempo, rng) for shape, _ in sizes], axis=1)
    s = np.clip(t / RAMP_S, 0.0, 1.0)
    grown = (s * s * (3 - 2 * s))[:, None]
    sway = calm * grown * np.clip(unit, -1, 1) * np.array([size for _, size in sizes])
    sway[:, 0] += grown[:, 0] * _FORWARD[rig.name]
    sway[:, 2] -= grown[:, 0] * _LOWER[rig.name]
    if rig.name == "quadruped":
        return _quadruped(kind, t, sway, calm * grown, rng)
    return _humanoid(rig, kind, t, sway, calm * grown, rng)


def _quadruped(
    kind: str,
    t: Float[np.ndarray, " sample"],
    sway: Float[np.ndarray, "sample 6"],
    grown: Float[np.ndarray, "sample 1"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"]:
    rig = rigs.QUADRUPED
    x, y = rigs.HIP_AT[0], rigs.HIP_AT[1] + rigs.HIP_ASIDE
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    stand = np.zeros((len(t), 4, 3))
    stand[:, :, :2] = signs * np.array([x, y + _ASTRIDE])
    stand[:, :, 2] = rigs.PAW - rig.height
    if kind == "trot":
        stand = stand + gaits.trot(t, stand[0], grown, rng)
    elif kind in ("walk", "paw"):
        stand = stand + gaits.walk(t, stand[0], grown, rng, on_the_spot=kind == "paw")
    turn = legs.rotation(sway[:, 3], sway[:, 4], sway[:, 5])
    seen = np.einsum("nji,nlj->nli", turn, stand - sway[:, None, :3])
    angles = [legs.paw(leg, seen[:, i]) for i, leg in enumerate(rigs.QUADRUPED_LEGS)]
    return _within(rig, np.concatenate(angles, axis=1))


def _humanoid(
    rig: Legged,
    kind: str,
    t: Float[np.ndarray, " sample"],
    sway: Float[np.ndarray, "sample 6"],
    grown: Float[np.ndarray, "sample 1"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "sample joint"]:
    turn = legs.rotation(sway[:, 3], sway[:, 4], sway[:, 5])
    back = turn.transpose(0, 2, 1)
    angles = []
    for side, y in zip(rigs.SIDES, (1.0, -1.0), strict=True):
        ankle = np.array([0.0, y * rigs.PELVIS_AT[0], rigs.SOLE - rig.height]) - sway[:, :3]
        angles.append(legs.leg(side, np.einsum("nij,nj->ni", back, ankle), back))
    shape, size = _UPPER[kind]
    upper = rig.links[12:]
    unit = np.stack([SHAPES[shape](t, rng) for _ in upper], axis=1)
    room = size * np.array([link.amplitude for link in upper])
    angles.append(np.array([link.middle for link in upper]) + grown * room * np.clip(unit, -1, 1))
    return _within(rig, np.concatenate(angles, axis=1))


def _within(
    rig: Legged, path: Float[np.ndarray, "sample joint"]
) -> Float[np.ndarray, "sample joint"]:
    """Positions kept clear of the ends of the joints' ranges."""
    low, high = np.array([link.span for link in rig.links]).T
    return np.clip(path, low + 0.05, high - 0.05)
