"""Single-step error under teacher forcing: every prediction starts from R's own observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.types import Channel, Pairs, Transitions, TransitionSpec


@dataclass(frozen=True)
class ErrorScales:
    """Units of errors: R's spread in the training data.

    Attributes:
        state: standard deviation of the next state, physical units.
        change: standard deviation of the one-step change, physical units.
    """

    state: Float[np.ndarray, " state"]
    change: Float[np.ndarray, " state"]

    @classmethod
    def of(cls, real: Transitions, spec: TransitionSpec) -> ErrorScales:
        """ErrorScales of R's training transitions."""
        change = real.s_next - real.o[:, : spec.n_state]
        return cls(real.s_next.std(axis=0), change.std(axis=0))


@dataclass(frozen=True)
class Errors:
    """One method's error with one seed.

    Attributes:
        mse: mean squared error of the normalised next state.
        mse_change: mean squared error in units of the change's standard deviation.
        rmse: per channel in physical units.
    """

    mse: float
    mse_change: float
    rmse: Float[np.ndarray, " state"]

    @property
    def physical(self) -> float:
        """Mean square over all channels in their own units: rad, rad/s and so on."""
        return float(np.mean(self.rmse**2))


def errors(predicted: Float[np.ndarray, "pair state"], pairs: Pairs, scales: ErrorScales) -> Errors:
    """Error of predicted next states, physical units."""
    error = predicted.astype(np.float64) - pairs.real.s_next
    return Errors(
        mse=float(np.mean((error / scales.state) ** 2)),
        mse_change=float(np.mean((error / scales.change) ** 2)),
        rmse=np.sqrt(np.mean(error**2, axis=0)),
    )


def by_kind(
    rmse: Float[np.ndarray, "*of state"], channels: Sequence[Channel]
) -> dict[Channel, Float[np.ndarray, "*of"]]:
    """Root mean squared errors over the channels of one kind, e.g. ``qpos`` [rad].

    Args:
        rmse: of each channel, physical units.
        channels: their names and units.

    Returns:
        By the name that a kind's channels begin with, and their unit.
    """
    rows: dict[Channel, list[int]] = {}
    for c, channel in enumerate(channels):
        kind = Channel(channel.name.partition("/")[0], channel.unit)
        rows.setdefault(kind, []).append(c)
    mean = {kind: np.mean(rmse[..., of] ** 2, axis=-1) for kind, of in rows.items()}
    return {kind: np.asarray(np.sqrt(square)) for kind, square in mean.items()}


def first_episode(pairs: Pairs, longest: int) -> Int[np.ndarray, " row"]:
    """Rows of the first unbroken episode, at most ``longest``."""
    real = pairs.real
    unbroken = (real.episode == real.episode[0]) & (
        real.step == real.step[0] + np.arange(len(real))
    )
    length = len(real) if unbroken.all() else int(np.argmin(unbroken))
    return np.arange(min(length, longest))


def poses(
    model: mujoco.MjModel, spec: TransitionSpec, states: Float[np.ndarray, "time state"]
) -> Float[np.ndarray, "time qpos"]:
    """Joint positions of the whole model for drawing; joints not in the task rest.

    Args:
        model: the MJCF that is drawn.
        spec: layout of the task.
        states: state channels.
    """
    qpos = np.tile(model.qpos0, (len(states), 1))
    for joint, channel in zip(spec.joints, spec.pose, strict=True):
        qpos[:, model.joint(joint).qposadr[0]] = states[:, channel]
    return qpos
