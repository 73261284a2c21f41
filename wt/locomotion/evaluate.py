"""Figures of a policy that walks: tracking, falls, power and gait, on the exported graph.

Nothing is pushed and nobody restarts: a robot that fell counts as fallen from there on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Bool

from wt.locomotion.config import PolicyConfig
from wt.locomotion.env import make_herd, sample_commands
from wt.locomotion.feet import FootSensors
from wt.worlds.legged import COMMAND, Herd, Start

Act = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""From observation, command and clock to action, as :meth:`wt.worlds.policy.Policy.act`."""

SETTLE_SECONDS = 2.0
TRACK_SECONDS = 8.0
WALK_SECONDS = 60.0
_WINDOW = 1.0  # s: over which velocities are averaged, about two strides
_LIFTED = 0.01  # m: a foot that rose less was not lifted


@dataclass(frozen=True)
class CommandTracking:
    """Tracking of one constant command.

    Attributes:
        axis: one of :data:`wt.worlds.legged.COMMAND`.
        command: [m/s] or [rad/s].
        mean: velocity reached, over time and robots.
        error: mean of |1 s averages of the velocity − command| over |command|, robots and time.
        drift: the same of the other two axes' largest, relative to their own largest command.
        fallen: share of robots that fell.
    """

    axis: str
    command: float
    mean: float
    error: float
    drift: float
    fallen: float


@dataclass(frozen=True)
class WalkFigures:
    """Figures of a minute of changing commands.

    Attributes:
        robots: their number.
        seconds: duration of each walk [s].
        fallen: share that fell.
        power: mean Σ|τ q̇| [W].
        cost_of_transport: power over weight and mean speed, where the command is over 0.3 m/s.
        duty_factor: share of time that a foot is on the ground while walking.
        clearance: median height to which feet are lifted in a swing [m].
        step_seconds: median time of a swing [s].
        strides_hz: landings of a foot per second while walking.
    """

    robots: int
    seconds: float
    fallen: float
    power: float
    cost_of_transport: float
    duty_factor: float
    clearance: float
    step_seconds: float
    strides_hz: float


@dataclass(frozen=True)
class PolicyEvaluation:
    """All figures of a policy."""

    tracking: tuple[CommandTracking, ...]
    walk: WalkFigures

    def plain(self) -> dict[str, object]:
        """The figures as nested plain values, for JSON."""
        return asdict(self)

    @property
    def worst_error(self) -> float:
        """Largest relative tracking error of any axis."""
        return max(t.error for t in self.tracking)


def evaluate(
    config: PolicyConfig,
    act: Act,
    *,
    threads: int = 0,
    robots: int = 16,
    walkers: int = 64,
    seed: int = 1,
) -> PolicyEvaluation:
    """Let a policy walk in the scene that it was trained in.

    Args:
        config: says robot, physics, scene and commands.
        act: the policy.
        threads: physics threads; 0 for one per core.
        robots: for each of the six constant commands.
        walkers: robots that walk for a minute.
        seed: of starts and commands.
    """
    return PolicyEvaluation(
        _track(config, act, threads, robots, seed), _walk(config, act, threads, walkers, seed)
    )


def _track(
    config: PolicyConfig, act: Act, threads: int, robots: int, seed: int
) -> tuple[CommandTracking, ...]:
    largest = np.array(config.commands.largest, np.float32)
    axes = [(a, sign) for a in range(3) for sign in (1, -1) if largest[a] > 0]
    command = np.zeros((len(axes) * robots, 3), np.float32)
    for k, (a, sign) in enumerate(axes):
        command[k * robots : (k + 1) * robots, a] = sign * largest[a]
    herd = make_herd(config, len(command), threads)
    rng = np.random.default_rng(seed)
    herd.reset(np.arange(herd.size), rng, Start(joints=0.05, area=config.episodes.start.area))
    clock = config.clock(herd.size)
    steps = round((SETTLE_SECONDS + TRACK_SECONDS) / herd.dt)
    velocity = np.empty((steps, herd.size, 3))
    fallen = np.zeros(herd.size, bool)
    for k in range(steps):
        herd.step(act(herd.observe(), command, clock.read(herd.time, command)))
        velocity[k] = herd.velocity()[:, :3]
        fallen |= herd.fallen()
    settled = velocity[round(SETTLE_SECONDS / herd.dt) :]
    window = round(_WINDOW / herd.dt)
    averages = settled[: len(settled) // window * window]
    averages = averages.reshape(-1, window, herd.size, 3).mean(1)
    out = []
    for k, (a, sign) in enumerate(axes):
        these = slice(k * robots, (k + 1) * robots)
        off = np.abs(averages[:, these] - command[these]).mean((0, 1))
        others = [off[b] / largest[b] for b in range(3) if b != a and largest[b] > 0]
        out.append(
            CommandTracking(
                axis=COMMAND[a],
                command=float(sign * largest[a]),
                mean=float(settled[:, these, a].mean()),
                error=float(off[a] / largest[a]),
                drift=float(max(others, default=0.0)),
                fallen=float(fallen[these].mean()),
            )
        )
    return tuple(out)


def _walk(config: PolicyConfig, act: Act, threads: int, robots: int, seed: int) -> WalkFigures:
    herd = make_herd(config, robots, threads)
    feet, gait, clock = FootSensors(herd), _GaitAccumulator(herd), config.clock(robots)
    rng = np.random.default_rng(seed + 1)
    herd.reset(np.arange(robots), rng, Start(joints=0.05, area=config.episodes.start.area))
    feet.forget(np.arange(robots))
    fallen = np.zeros(robots, bool)
    for k in range(round(WALK_SECONDS / herd.dt)):
        if k % round(config.commands.seconds / herd.dt) == 0:
            command = sample_commands(config.commands, robots, rng)
        herd.step(act(herd.observe(), command, clock.read(herd.time, command)))
        feet.update()
        fallen |= herd.fallen()
        gait.add(feet, ~fallen, np.hypot(command[:, 0], command[:, 1]) > 0.3)
    return WalkFigures(
        robots=robots, seconds=WALK_SECONDS, fallen=float(fallen.mean()), **gait.figures()
    )


class _GaitAccumulator:
    """Sums up what the feet and drives of a herd do."""

    def __init__(self, herd: Herd) -> None:
        self._herd = herd
        self._torque = herd.batch.bind("actuator_force")
        self._weight = herd.weight
        self._highest = np.zeros((herd.size, len(herd.robot.feet)))
        self._powers: list[float] = []
        self._costs: list[tuple[float, float]] = []  # power and speed while walking
        self._duty: list[tuple[float, int]] = []
        self._swings: list[np.ndarray] = []  # clearance and time of each swing, (K, 2)

    def add(
        self,
        feet: FootSensors,
        upright: Bool[np.ndarray, " robot"],
        walking: Bool[np.ndarray, " robot"],
    ) -> None:
        """Take in one control step.

        Args:
            feet: of all robots.
            upright: true where a robot has not fallen.
            walking: true where the command is to walk.
        """
        herd, walking = self._herd, walking & upright
        power = (np.abs(self._torque) * np.abs(herd.joint_vel)).sum(1)
        velocity = herd.velocity()
        if upright.any():
            self._powers.append(float(power[upright].mean()))
        if walking.any():
            speed = np.hypot(velocity[walking, 0], velocity[walking, 1]).sum()
            self._costs.append((float(power[walking].sum()), float(speed)))
            self._duty.append((float(feet.contact[walking].sum()), feet.contact[walking].size))
        np.maximum(self._highest, feet.clearance, out=self._highest)
        landed = feet.landed & walking[:, None] & (self._highest > _LIFTED)
        self._swings.append(np.stack([self._highest[landed], feet.air[landed]], axis=1))
        self._highest[feet.contact] = 0.0

    def figures(self) -> dict[str, float]:
        """The gait's part of :class:`WalkFigures`."""
        costs, duty = np.array(self._costs or [(0, 1)]), np.array(self._duty or [(0, 1)])
        swings = np.concatenate(self._swings)
        clearance, seconds = np.median(swings, axis=0) if len(swings) else (0.0, 0.0)
        foot_seconds = duty[:, 1].sum() * self._herd.dt
        return {
            "power": float(np.mean(self._powers or [0.0])),
            "cost_of_transport": float(costs[:, 0].sum() / (self._weight * costs[:, 1].sum())),
            "duty_factor": float(duty[:, 0].sum() / duty[:, 1].sum()),
            "clearance": float(clearance),
            "step_seconds": float(seconds),
            "strides_hz": float(len(swings) / foot_seconds),
        }


def table(evaluation: PolicyEvaluation) -> str:
    """The figures as lines of text."""
    lines = [f"{'command':<18}{'reached':>9}{'error':>8}{'drift':>8}{'fallen':>8}"]
    for t in evaluation.tracking:
        unit = "rad/s" if t.axis == "turn" else "m/s"
        what = f"{t.axis} {t.command:+.1f} {unit}"
        lines.append(f"{what:<22}{t.mean:>+5.2f}{t.error:>8.1%}{t.drift:>8.1%}{t.fallen:>8.0%}")
    w = evaluation.walk
    lines += [
        f"{w.robots} robots, {w.seconds:.0f} s of changing commands: {w.fallen:.1%} fell, "
        f"{w.power:.0f} W, cost of transport {w.cost_of_transport:.2f}",
        f"gait: duty factor {w.duty_factor:.2f}, clearance {100 * w.clearance:.1f} cm, "
        f"swing {w.step_seconds:.2f} s, {w.strides_hz:.1f} strides/s",
    ]
    return "\n".join(lines)
