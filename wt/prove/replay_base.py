"""Smooth curves through measurements, and the motion of a trunk that replays are led along."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_lsq_spline, make_smoothing_spline

from wt.types import Recording

QUICK, _SLOW = 0.02, 0.08
"""Between the knots of a joint's curve and of a trunk's [s]."""
_LONG = 4000  # samples


@dataclass(frozen=True, eq=False)
class Floating:
    """A free joint's measured motion.

    Attributes:
        joint: its name.
        t: times since the start [s].
        pose: position [m] and quaternion wxyz, smooth.
        speed: velocity in the world [m/s] and angular velocity in the body [rad/s].
    """

    joint: str
    t: Float[np.ndarray, " sample"]
    pose: Float[np.ndarray, "sample 7"]
    speed: Float[np.ndarray, "sample 6"]

    def at(
        self, t: Float[np.ndarray, " time"]
    ) -> tuple[Float[np.ndarray, "time 7"], Float[np.ndarray, "time 6"]]:
        """Pose and speed at given times [s]."""
        pose, speed = (
            np.stack([np.interp(t, self.t, column) for column in curve.T], axis=1)
            for curve in (self.pose, self.speed)
        )
        pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        return pose, speed


def floating(
    recording: Recording, model: mujoco.MjModel, t: Float[np.ndarray, " sample"]
) -> Floating | None:
    """The motion of a model's free joint; None if it has none, or it was not recorded."""
    free = mujoco.mjtJoint.mjJNT_FREE
    names = [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] == free]
    if not names or f"qpos/{names[0]}/0" not in recording.columns:
        return None
    curves = [fitted(t, recording.columns[f"qpos/{names[0]}/{i}"], _SLOW) for i in range(7)]
    pose, rate = np.stack(curves, axis=2)
    size = np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    quaternion, turn = pose[:, 3:] / size, rate[:, 3:] / size
    # ω = 2·(conjugate of q ⊗ q̇), its vector part: w·ṙ − ẇ·r − r × ṙ
    w, r, dw, dr = quaternion[:, :1], quaternion[:, 1:], turn[:, :1], turn[:, 1:]
    omega = 2.0 * (w * dr - dw * r - np.cross(r, dr))
    return Floating(
        names[0],
        t,
        np.concatenate([pose[:, :3], quaternion], axis=1),
        np.concatenate([rate[:, :3], omega], axis=1),
    )


def smooth(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, "2 sample"]:
    """Position and velocity of a smoothing spline through measurements.

    Its smoothness is chosen by generalised cross-validation (P. Craven and G. Wahba, 1979), which
    takes minutes for long recordings: they have a knot every :data:`QUICK`.
    """
    if len(t) > _LONG:
        return fitted(t, x, QUICK)
    known = np.isfinite(x)
    if known.sum() < 5:
        return np.zeros((2, len(t)))
    spline = make_smoothing_spline(t[known], x[known])
    return np.stack([spline(t), spline.derivative()(t)])


def fitted(
    t: Float[np.ndarray, " sample"], x: Float[np.ndarray, " sample"], spacing: float
) -> Float[np.ndarray, "2 sample"]:
    """Position and velocity of a least-squares spline with a knot every ``spacing`` [s].

    Quick for long recordings.
    """
    known = np.isfinite(x)
    if known.sum() < 5:
        return np.zeros((2, len(t)))
    # gaps are bridged, so that there is something between any two knots
    x = np.interp(t, t[known], x[known])
    spacing = max(spacing, 3.0 * float(np.diff(t).max()))
    inner = np.linspace(t[0], t[-1], max(int((t[-1] - t[0]) / spacing), 2))
    spline = make_lsq_spline(t, x, np.concatenate([[t[0]] * 3, inner, [t[-1]] * 3]))
    return np.stack([spline(t), spline.derivative()(t)])
