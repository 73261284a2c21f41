"""The terms of the reward: pure functions of a control step, one number per robot.

Every term is zero or positive; the names of :class:`wt.locomotion.config.Rewards` say which are
rewards (:data:`WANTED`), all others are penalties. The penalty of a fall is large enough that an
early fall is not the cheaper way while the sum of all is still negative.

Sources: legged_gym (Rudin et al. 2022) for most, mjlab for clearance, Isaac Lab for single stance,
unitree_rl_gym for the rhythm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from wt.locomotion.config import Rewards, fitting

WANTED = ("track_linear", "track_turn", "alive", "air_time", "single_stance", "rhythm")


@dataclass(frozen=True)
class Step:
    """One control step of many robots.

    Attributes:
        command: velocities that are asked for [m/s, m/s, rad/s].
        moving: true where a robot is to move, and not to stand.
        velocity: as commands mean it, and upward [m/s, m/s, rad/s, m/s].
        gyro: angular velocity in the trunk's frame [rad/s].
        gravity: its direction in the trunk's frame.
        height: of the trunk over the ground, less that of the default pose [m].
        pose: joint positions less the default pose [rad].
        excess: distance of joints beyond the soft limits [rad].
        joint_vel: joint velocities [rad/s].
        joint_acc: change of ``joint_vel`` over the step's time [rad/s²].
        torque: of the drives [N·m].
        action: in units of the action scale.
        last_action: the one before.
        contact, landed: as in :class:`wt.locomotion.feet.FootSensors`.
        others: contacts of other parts than feet.
        force: of contact, in units of the robot's weight [-].
        clearance: of the feet [m].
        foot_speed: horizontal [m/s].
        air, stance: times that feet are up or down [s].
        swing: share of the swing that a foot's rhythm wants, as
            :meth:`wt.worlds.gait.Gait.swing`; −1 where it rests, and without one.
        dt: length of the step [s].
    """

    command: Float32[np.ndarray, "robot command=3"]
    moving: Bool[np.ndarray, " robot"]
    velocity: Float32[np.ndarray, "robot velocity=4"]
    gyro: Float32[np.ndarray, "robot xyz=3"]
    gravity: Float32[np.ndarray, "robot xyz=3"]
    height: Float32[np.ndarray, " robot"]
    pose: Float32[np.ndarray, "robot joint"]
    excess: Float32[np.ndarray, "robot joint"]
    joint_vel: Float32[np.ndarray, "robot joint"]
    joint_acc: Float32[np.ndarray, "robot joint"]
    torque: Float32[np.ndarray, "robot joint"]
    action: Float32[np.ndarray, "robot joint"]
    last_action: Float32[np.ndarray, "robot joint"]
    contact: Bool[np.ndarray, "robot foot"]
    landed: Bool[np.ndarray, "robot foot"]
    others: Float32[np.ndarray, " robot"]
    force: Float32[np.ndarray, "robot foot"]
    clearance: Float[np.ndarray, "robot foot"]  # double precision over blocks
    foot_speed: Float32[np.ndarray, "robot foot"]
    air: Float32[np.ndarray, "robot foot"]
    stance: Float32[np.ndarray, "robot foot"]
    swing: Float32[np.ndarray, "robot foot"]
    dt: float


# Not annotated with a shape: two dozen terms are computed in every control step, and checking each
# would cost a third of it. They work on the fields of Step, and their sum is checked.
PerRobot = np.ndarray
"""A term: one number per robot."""


def _squares(x: np.ndarray) -> PerRobot:
    out: np.ndarray = np.einsum("ij,ij->i", x, x)
    return out


def _tracked(squared_error: PerRobot, width: float, precise: float) -> PerRobot:
    # (1 − p) exp(−e² / σ²) + p exp(−e² / (σ/4)²): the wide one calls from afar, the narrow one
    # still tells 0.1 from 0.2 m/s
    e = squared_error / np.float32(width**2)
    share = np.float32(precise)
    return (1 - share) * np.exp(-e) + share * np.exp(-16 * e)


def track_linear(step: Step, r: Rewards) -> PerRobot:
    """``_tracked`` of ‖v_xy − v*_xy‖."""
    error = step.velocity[:, :2] - step.command[:, :2]
    return _tracked(_squares(error), r.linear_width, r.precise)


def track_turn(step: Step, r: Rewards) -> PerRobot:
    """``_tracked`` of ω_z − ω*_z."""
    error = step.velocity[:, 2] - step.command[:, 2]
    return _tracked(np.square(error), r.turn_width, r.precise)


def alive(step: Step, r: Rewards) -> PerRobot:
    """1."""
    return np.ones(len(step.command), np.float32)


def vertical(step: Step, r: Rewards) -> PerRobot:
    """v_z²."""
    return np.square(step.velocity[:, 3])


def rolling(step: Step, r: Rewards) -> PerRobot:
    """ω_x² + ω_y²."""
    return _squares(step.gyro[:, :2])


def tilt(step: Step, r: Rewards) -> PerRobot:
    """g_x² + g_y²."""
    return _squares(step.gravity[:, :2])


def height(step: Step, r: Rewards) -> PerRobot:
    """(z − z₀)², in units of (10 cm)²."""
    return np.square(10 * step.height)


def torque(step: Step, r: Rewards) -> PerRobot:
    """Σ τ²."""
    return _squares(step.torque)


def power(step: Step, r: Rewards) -> PerRobot:
    """Σ |τ q̇|."""
    out: np.ndarray = np.einsum("ij,ij->i", np.abs(step.torque), np.abs(step.joint_vel))
    return out


def acceleration(step: Step, r: Rewards) -> PerRobot:
    """Σ q̈²."""
    return _squares(step.joint_acc)


def action_rate(step: Step, r: Rewards) -> PerRobot:
    """Σ (a_t − a_{t−1})²."""
    return _squares(step.action - step.last_action)


def limits(step: Step, r: Rewards) -> PerRobot:
    """Σ of the joints' distances beyond their soft limits."""
    out: np.ndarray = step.excess.sum(1)
    return out


def bumps(step: Step, r: Rewards) -> PerRobot:
    """Number of contacts of other parts than feet."""
    return step.others


def slip(step: Step, r: Rewards) -> PerRobot:
    """Σ over standing feet of ‖v_foot,xy‖²."""
    out: np.ndarray = (np.square(step.foot_speed) * step.contact).sum(1)
    return out


def clearance(step: Step, r: Rewards) -> PerRobot:
    """Σ over feet of |h_foot − h*| ‖v_foot,xy‖, where the robot is to move and the foot is up."""
    missing = np.abs(step.clearance - np.float32(r.swing_height)) * ~step.contact
    out: np.ndarray = (missing * step.foot_speed).sum(1) * step.moving
    return out


def air_time(step: Step, r: Rewards) -> PerRobot:
    """Σ over landing feet of max(0, min(t_air, 1.5 T) − 0.5 T) per time, where it is to move.

    As legged gym's Σ (t_air − T), but a short step is worth nothing rather than less, and a very
    long one no more. Landing is an event of one step: its worth is spread over that step's time.
    """
    wanted = np.float32(r.air_seconds)
    worth = np.clip(step.air - 0.5 * wanted, 0, wanted) * step.landed
    out: np.ndarray = worth.sum(1) * step.moving / np.float32(step.dt)
    return out


def single_stance(step: Step, r: Rewards) -> PerRobot:
    """min(t of the stance leg and of the swing leg, T) while a biped stands on one."""
    one = step.contact.sum(1) == 1
    since = np.where(step.contact, step.stance, step.air).min(1)
    return np.minimum(since, np.float32(r.stance_seconds)) * one * step.moving


def rhythm(step: Step, r: Rewards) -> PerRobot:
    """Share of the feet that stand or swing as their rhythm wants."""
    return (step.contact == (step.swing < 0)).mean(1, dtype=np.float32)


def load(step: Step, r: Rewards) -> PerRobot:
    """Σ over feet in their swing of the weight on them, at most the robot's own."""
    out: np.ndarray = (np.minimum(step.force, 1.0) * (step.swing >= 0)).sum(1)
    return out


def lift(step: Step, r: Rewards) -> PerRobot:
    """Σ over feet in their swing of ((h_foot − h* sin πs) / h*)²."""
    up = np.float32(r.swing_height) * np.sin(np.float32(np.pi) * np.maximum(step.swing, 0))
    missing = np.square((step.clearance - up) / np.float32(r.swing_height))
    out: np.ndarray = (missing * (step.swing >= 0)).sum(1)
    return out


def flight(step: Step, r: Rewards) -> PerRobot:
    """1 while no foot is on the ground, where it is to move."""
    out: np.ndarray = ~step.contact.any(1) & step.moving
    return out.astype(np.float32)


def impact(step: Step, r: Rewards) -> PerRobot:
    """Σ over landing feet of their force, in units of the robot's weight, per time."""
    out: np.ndarray = (step.force * step.landed).sum(1) / np.float32(step.dt)
    return out


def still(step: Step, r: Rewards) -> PerRobot:
    """Σ |q − q₀| and the number of lifted feet, where the robot is to stand."""
    return (np.abs(step.pose).sum(1) + (~step.contact).sum(1)) * ~step.moving


Term = Callable[[Step, Rewards], np.ndarray]
TERMS: Mapping[str, Term] = {
    term.__name__: term
    for term in (
        track_linear, track_turn, alive, vertical, rolling, tilt, height, torque, power,
        acceleration, action_rate, limits, bumps, slip, clearance, air_time, single_stance, rhythm,
        load, lift, flight, impact, still,
    )
}  # fmt: skip


class RewardSum:
    """The weighted sum of the terms for one robot."""

    def __init__(self, rewards: Rewards, joints: tuple[str, ...]) -> None:
        """Look up the weights.

        Args:
            rewards: weights per second and constants.
            joints: names, which ``rewards.posture`` has patterns of; a later pattern wins.

        Raises:
            ConfigError: a pattern fits no joint.
        """
        self._rewards = rewards
        self._weights = {
            name: (1.0 if name in WANTED else -1.0) * getattr(rewards, name)
            for name in TERMS
            if getattr(rewards, name)
        }
        self._posture = np.zeros(len(joints), np.float32)
        for pattern, weight in rewards.posture.items():
            self._posture[fitting("rewards.posture", pattern, joints)] = weight

    def __call__(
        self, step: Step, fallen: Bool[np.ndarray, " robot"]
    ) -> tuple[Float32[np.ndarray, " robot"], dict[str, float]]:
        """Reward of a step, and the mean of each weighted term per second.

        Args:
            step: the control step.
            fallen: true where a robot fell in it.
        """
        total = -(np.square(step.pose) @ self._posture)
        means = {"posture": float(total.mean())} if self._posture.any() else {}
        for name, weight in self._weights.items():
            part = np.float32(weight) * TERMS[name](step, self._rewards)
            means[name] = float(part.mean())
            total += part
        reward = total * np.float32(step.dt)
        reward -= np.float32(self._rewards.fall) * fallen
        return reward.astype(np.float32), means
