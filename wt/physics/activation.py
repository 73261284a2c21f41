"""What the model's own drives make of their commands before they act: delays, filters, integrators.

A drive with dynamics acts on its activation and not on its command. Between samples commands are
held, so that the activation at each sample follows exactly from the one before (MuJoCo's
documentation, Computation: activation dynamics).
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.physics.held import impulses

_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)


def activated(
    model: mujoco.MjModel,
    t: Float[np.ndarray, " sample"],
    command: Float[np.ndarray, "sample actuator"],
    start: Float[np.ndarray, " actuator"] | None = None,
) -> Float[np.ndarray, "sample actuator"]:
    """What each drive acts on at each sample: its activation, or its command if it has none.

    Args:
        model: the machine.
        t: time of the samples (K,) [s].
        command: commands sent at each sample, held until the next, (K, nu).
        start: activations of integrators at the first sample, (nu,); zero if left out. Filters
            begin as if their first command had been sent for long.
    """
    acted = command.copy()
    for i in late(model):
        acted[:, i] = _late(t, command[:, i], float(model.actuator_delay[i]))
    for i in np.flatnonzero(dynamic(model)):
        u = acted[:, i].copy()
        if model.actuator_ctrllimited[i]:
            u = np.clip(u, *model.actuator_ctrlrange[i])
        limited = bool(model.actuator_actlimited[i])
        low, high = model.actuator_actrange[i] if limited else (-np.inf, np.inf)
        integrates = int(model.actuator_dyntype[i]) == _INTEGRATOR
        x = (0.0 if start is None else float(start[i])) if integrates else float(u[0])
        keep = np.exp(-np.diff(t) / max(float(model.actuator_dynprm[i, 0]), mujoco.mjMINVAL))
        for k, dt in enumerate(np.diff(t)):
            acted[k, i] = x = min(max(x, low), high)
            x = x + u[k] * dt if integrates else u[k] + (x - u[k]) * keep[k]
        acted[-1, i] = min(max(x, low), high)
    return acted


def _late(
    t: Float[np.ndarray, " sample"], u: Float[np.ndarray, " sample"], delay: float
) -> Float[np.ndarray, " sample"]:
    """Mean of a held command over each sample's interval that arrives so late."""
    if len(t) < 2:
        return u
    ends = np.append(t, 2.0 * t[-1] - t[-2]) - delay
    return np.asarray(impulses(t, u[:, None], ends)[:, 0] / np.diff(ends))


def dynamic(model: mujoco.MjModel) -> np.ndarray:
    """Mask of the actuators that act on an activation computed here, (nactuator,)."""
    return np.isin(model.actuator_dyntype, (*_FILTERS, _INTEGRATOR))


def late(model: mujoco.MjModel) -> Int[np.ndarray, " late"]:
    """Indices of the actuators that the model gives a delay."""
    return np.flatnonzero(model.actuator_history[:, 0] > 0)


def integrating(model: mujoco.MjModel) -> Int[np.ndarray, " integrator"]:
    """Indices of the actuators whose command is the rate of what they act on."""
    return np.flatnonzero(model.actuator_dyntype == _INTEGRATOR)


def following(model: mujoco.MjModel) -> Int[np.ndarray, " actuator"]:
    """Indices of the actuators whose first activation is what has become of their command.

    An integral of the error is not: it is the only activation of a ``pid`` without ``slewmax``.
    """
    pid = model.actuator_dyntype == mujoco.mjtDyn.mjDYN_PID
    limited = pid & (model.actuator_dynprm[:, 1] > 0.0)
    return np.flatnonzero(limited | (~pid & (model.actuator_actnum == 1)))
