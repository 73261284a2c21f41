"""Watchdogs and limits: pure functions of what was measured and what is wanted.

A *watchdog* returns what is wrong, in words, or None. Any word ends the motion: the runner goes to
damping and stays there. A *limit* returns a target that the robot can follow without harm.

Arrays have one value per joint. Times are in seconds, angles in radians.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float64

from deploy.robot import Command, Drives, Joints, State
from wt.errors import ConfigError, suggest


@dataclass(frozen=True)
class Limits:
    """Limits at which to stop, or to hold a policy back; KEY=VALUE words of ``wt-run`` set them.

    Attributes:
        stale_state: oldest state of the robot that is acted on [s].
        deadline: longest that the policy may take for an action [s].
        tilt: largest angle between the trunk's vertical and the world's [rad].
        range_slack: how far a joint may be measured outside of its range [rad].
        range_margin: how far inside of it targets stay [rad].
        slew: fastest change of a target [rad/s].
        speed: fastest joint, as a share of what its drive can do [-].
        jump: how far a joint may seem to move beyond its fastest between two states [rad].
        temperature: hottest motor [°C].
        battery: lowest charge [%].
        stand_error: how far off a joint may be for the robot to count as standing [rad].
        stand_seconds: how long it takes to stand up [s].
    """

    stale_state: float = 0.03
    deadline: float = 0.01
    tilt: float = 1.0
    range_slack: float = 0.15
    range_margin: float = 0.02
    slew: float = 60.0
    speed: float = 1.25
    jump: float = 0.1
    temperature: float = 80.0
    battery: float = 10.0
    stand_error: float = 0.3
    stand_seconds: float = 2.5

    def __post_init__(self) -> None:
        """Refuse what would switch a watchdog off."""
        for f in fields(self):
            if not 0 < getattr(self, f.name) < np.inf:
                raise ConfigError(
                    f"{f.name} is {getattr(self, f.name)}; a number above zero is needed"
                )

    @classmethod
    def parse(cls, overrides: list[str]) -> Limits:
        """The defaults, changed by ``KEY=VALUE`` words.

        Raises:
            ConfigError: a key is none of these, or a value no number above zero.
        """
        known = [f.name for f in fields(cls)]
        changes = {}
        for word in overrides:
            key, _, value = word.partition("=")
            if key not in known:
                raise ConfigError(f"{word!r}: no limit is called {key!r}; {suggest(key, known)}")
            try:
                changes[key] = float(value)
            except ValueError:
                raise ConfigError(f"{word!r}: a number is needed, e.g. {key}=0.5") from None
        return replace(cls(), **changes)


def stale(age: float, most: float) -> str | None:
    """A state or a command that is too old."""
    return f"{age * 1e3:.0f} ms old, {most * 1e3:.0f} ms is the most" if age > most else None


def overdue(waited: float, most: float) -> str | None:
    """An action that was asked for and did not come in time."""
    late = f"no action for {waited * 1e3:.0f} ms, {most * 1e3:.0f} ms is the most"
    return late if waited > most else None


def intruded(count: int) -> str | None:
    """Commands of somebody else."""
    if not count:
        return None
    return "another program commands the robot too: stop it (on a Go2, its sport mode)"


def not_finite(state: State) -> str | None:
    """A measurement that is no number."""
    for name in ("position", "velocity", "quaternion", "gyro"):
        values = getattr(state, name)
        if not np.isfinite(values).all():
            return f"measured {name} number {int(np.argmin(np.isfinite(values)))} is no number"
    return None


def tilted(quaternion: Float64[np.ndarray, "wxyz=4"], most: float) -> str | None:
    """A trunk that has tipped over; orientation in the world, wxyz."""
    # cosine of the angle between the two verticals: R₃₃ = 1 − 2 (x² + y²)
    x, y = quaternion[1:3] / max(float(np.linalg.norm(quaternion)), 1e-9)
    angle = float(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1)))
    return f"the trunk is tilted by {angle:.2f} rad, {most:g} is the most" if angle > most else None


def out_of_range(q: Joints, drives: Drives, slack: float) -> str | None:
    """A joint that is measured where it cannot be: number and angle."""
    beyond = np.maximum(drives.low - q, q - drives.high)
    k = int(np.argmax(beyond))
    if beyond[k] <= slack:
        return None
    return f"joint {k} is at {q[k]:.2f} rad, {drives.low[k]:.2f} … {drives.high[k]:.2f} is possible"


def too_fast(dq: Joints, drives: Drives, share: float) -> str | None:
    """A joint that moves faster than its drive can."""
    excess = np.abs(dq) / (share * drives.speed)
    k = int(np.argmax(excess))
    if excess[k] <= 1:
        return None
    return f"joint {k} moves at {dq[k]:.1f} rad/s, {share * drives.speed[k]:.1f} is the most"


def jumped(
    q: Joints, before: Joints, seconds: float, drives: Drives, share: float, slack: float
) -> str | None:
    """A joint that seems to have moved farther than it can: a flipped sign, a slipped encoder.

    Args:
        q: positions.
        before: positions of the state before.
        seconds: between the two.
        drives: how fast joints can be.
        share: of that, as in :func:`too_fast`.
        slack: what noise may add.
    """
    moved = np.abs(q - before)
    excess = moved - share * drives.speed * max(seconds, 0.0)
    k = int(np.argmax(excess))
    if excess[k] <= slack:
        return None
    return f"joint {k} jumped by {moved[k]:.2f} rad in {seconds * 1e3:.0f} ms"


def hot(temperature: Joints, most: float) -> str | None:
    """A motor that is too hot."""
    k = int(np.argmax(temperature))
    if temperature[k] <= most:
        return None
    return f"motor {k} is at {temperature[k]:.0f} °C, {most:g} is the most"


def flat(battery: float, least: float) -> str | None:
    """A battery that is nearly empty."""
    return f"the battery is at {battery:g} %, {least:g} is the least" if battery < least else None


def bad_action(action: np.ndarray, joints: int) -> str | None:
    """A policy's output that cannot be commanded."""
    if action.shape != (joints,):
        return f"the policy's output has shape {action.shape}, ({joints},) is needed"
    if not np.isfinite(action).all():
        return f"the policy's output number {int(np.argmin(np.isfinite(action)))} is no number"
    return None


def faults(
    state: State, before: State | None, drives: Drives, limits: Limits
) -> Iterator[tuple[str, str]]:
    """Name and words of each thing that is wrong with a state.

    Args:
        state: the newest.
        before: the one before it, if there is one.
        drives: what the robot can take.
        limits: when to stop.
    """
    reasons = {"not_finite": not_finite(state)}
    if reasons["not_finite"] is None:  # comparisons with NaN would all hold
        reasons["tilt"] = tilted(state.quaternion, limits.tilt)
        reasons["range"] = out_of_range(state.position, drives, limits.range_slack)
        reasons["speed"] = too_fast(state.velocity, drives, limits.speed)
        if before is not None:
            reasons["jump"] = jumped(
                state.position, before.position, state.time - before.time, drives, limits.speed,
                limits.jump,
            )  # fmt: skip
        reasons["temperature"] = hot(state.temperature, limits.temperature)
        reasons["battery"] = flat(state.battery, limits.battery)
    yield from ((name, words) for name, words in reasons.items() if words)


def within_range(target: Joints, drives: Drives, margin: float) -> Joints:
    """A target inside of the joints' range."""
    return np.clip(target, drives.low + margin, drives.high - margin)


def slewed(target: Joints, before: Joints, step: float) -> Joints:
    """A target that is at most ``step`` [rad] from the one before."""
    return before + np.clip(target - before, -step, step)


def within_torque(command: Command, state: State, torque: Joints) -> Joints:
    """A target for which the gains ask for no more torque than the drives have [N·m].

    Where the position gain is zero the target has no say and stays.
    """
    k, d = command.stiffness, command.damping
    # |k (target − q) − d q̇| ≤ torque
    stiff = np.maximum(k, 1e-9)
    middle = state.position + d * state.velocity / stiff
    clipped = np.clip(command.target, middle - torque / stiff, middle + torque / stiff)
    return np.where(k > 0, clipped, command.target)
