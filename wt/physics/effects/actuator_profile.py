"""A position drive whose firmware plans a trapezoidal profile of velocity to every command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from wt.physics.effect import LEAST, Parameter, Shape, register
from wt.physics.hooks import Beyond, Intervals, Nested, OnGoals, Remembering
from wt.physics.motion import Motion
from wt.physics.replay import Inputs, Stretch
from wt.physics.scene import Drive, Scene
from wt.physics.script import Script, number
from wt.physics.servos import Goal, fastest, profiled, sent, servos
from wt.physics.units import HINGE, Units
from wt.types import Location

_STEP_S = 1e-3
"""Longest step in which a profile is followed along recordings and up to replays [s]."""
_RISES_S = (0.05, 0.12, 0.3, 0.8)
"""Times in which a goal may come to be as fast as the joint ever was [s]."""
_SHARES = (0.8, 1.1)
"""Of a joint's fastest motion that are tried as its goal's: a servo overshoots a little."""
_ENDLESS = 1e5
"""A speed that is no limit [rad/s]."""
_REACHED = 0.98
"""Share of a limit of speed from which a goal has come to it, as far as anybody can tell."""
_AT_ONCE_S = 5e-3
"""A profile that may reach its speed within this time is a limited speed."""


@register
class ActuatorProfile(Nested, Remembering, OnGoals):
    """|dg/dt| ≤ speed and |d²g/dt²| ≤ acceleration, so that g stops at u; the drive goes to g.

    The goal g is as fast as it can be stopped from: √(2 · acceleration · |u − g|) at most.
    """

    id = "actuator.profile"
    kind = "actuator"
    parameters = (
        Parameter("speed", "rad/s", LEAST, 1e6, 1e-3),
        Parameter("acceleration", "rad/s²", LEAST, 1e8, 1e-2),
    )
    reference = "L. Biagiotti and C. Melchiorri, Trajectory Planning for Automatic Machines and "
    reference += "Robots, 2008, chapter 3 (trapezoidal profiles)"
    native = False
    signed = (1,)
    excludes = ("actuator.lag", "actuator.slew_rate")
    looks_like = ("delay",)
    plotted_over = "velocity"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives that follow a position as it is sent."""
        return servos(scene)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Speeds around the joint's fastest, and accelerations to that.

        None without a limit of speed: from there no small step leads back to one.
        """
        most = fastest(motion, motion.scene.drive(at.name))
        if most == 0.0:
            return []
        return [(s * most, most / rise) for s in _SHARES for rise in _RISES_S]

    def beyond(
        self, motion: Motion, at: Location, law: str, theta: Float[np.ndarray, " smaller"]
    ) -> Sequence[Beyond]:
        """A limited speed that takes its time to be reached."""
        if law != "actuator.slew_rate":
            return []
        speed = float(theta[0])
        return [((speed, speed / rise), np.array([speed, speed / rise])) for rise in _RISES_S]

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """A limited speed that is reached at once; an acceleration, where that speed never is."""
        if theta[0] < _AT_ONCE_S * np.max(intervals["acceleration"][1]):
            return "actuator.slew_rate", theta[:1]
        if _REACHED * _fastest_goal(motion, at, float(theta[1])) < theta[0] < 0.5 * _ENDLESS:
            return self.id, np.array([_ENDLESS, theta[1]])
        return None

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force under the profile minus force under the command as sent."""
        drive, late = motion.scene.drive(at.name), np.empty(len(motion))
        for s in motion.segments:
            u = np.clip(motion.command[s.rows, drive.index], *drive.commands)
            parts = 2 * max(1, int(np.ceil(0.5 * s.dt / _STEP_S)))
            goals = _followed(u, s.dt, parts, drive, shape, Goal(float(u[0])))[:, 0]
            starts = np.concatenate([u[:1], goals[:-1]])
            halves = (0.5 * (starts + goals)).reshape(-1, parts // 2).mean(axis=1)
            before = np.concatenate([halves[:1], halves[1:-1:2]])
            late[s.rows] = 0.5 * (before + halves[::2])
        change = motion.force(drive, late) - motion.force(drive)
        return motion.on(drive.dof, change)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The shape, whatever the coefficient: the right one's is 1."""
        return np.array(shape)

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Follow the profile from where it has got to."""
        drive, first = scene.drive(at.name), inputs.before
        u = np.clip(inputs.u[first:, drive.index], *drive.commands)
        start = Goal(float(u[0]))
        if inputs.stretch is not None:
            start = _begin(inputs.stretch, drive, theta)
        speed, acceleration = (np.abs(drive.gear) * theta).tolist()
        followed = profiled(u, inputs.h, speed, acceleration, start)
        inputs.u[first:, drive.index] = followed[:, 0]

    def remembered(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, float]:
        """The goal, and its rate."""
        if stretch.motion is None:
            return {}
        begun = _begin(stretch, stretch.motion.scene.drive(at.name), theta)
        return {f"{at.name} profile": begun.at, f"{at.name} profile's rate": begun.rate}

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Follow the profile, and pull to it instead of the command."""
        speed, acceleration = map(number, theta)
        force = (
            f'goal = self._profile("{at.name}", ctrl, {speed}, {acceleration}, h)',
            f'ctrl = self._command("{at.name}", goal, qpos, qvel, ctrl, f)',
        )
        return Script(force=force, helpers=("profile",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        limits = f"{theta[1]:.3g} {units.of('rad/s²')}"
        if theta[0] < 0.5 * _ENDLESS:
            limits = f"{theta[0]:.3g} {units.speed} and {limits}"
        return (
            f"Actuator {at.name} moves its goal towards the command by a profile of at most "
            f"{limits}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"steps of {at.name}, small and large, whose flanks tell a profile from a lag"


def _fastest_goal(motion: Motion, at: Location, acceleration: float) -> float:
    """Fastest that a goal without a limit of its speed moves, of the joint [rad/s]."""
    drive, most = motion.scene.drive(at.name), 0.0
    for s in motion.segments:
        u = np.clip(motion.command[s.rows, drive.index], *drive.commands)
        parts, limits = max(1, int(np.ceil(s.dt / _STEP_S))), (_ENDLESS, acceleration)
        rates = _followed(u, s.dt, parts, drive, limits, Goal(float(u[0])))[:, 1]
        most = max(most, float(np.abs(rates).max()))
    return most / abs(drive.gear)


def _begin(stretch: Stretch, drive: Drive, theta: Float[np.ndarray, " parameter"]) -> Goal:
    """Where the goal of a drive has got to when a stretch begins."""
    known = sent(stretch, drive)
    goal = Goal(float(known.u[0]))
    for u, dt in ((known.u[:-1], known.dt), (known.u[-1:], known.last)):
        if len(u) and dt > 0.0:
            parts = max(1, int(np.ceil(dt / _STEP_S)))
            goal = Goal(*_followed(u, dt, parts, drive, theta.tolist(), goal)[-1].tolist())
    return goal


def _followed(
    u: Float[np.ndarray, " sample"],
    dt: float,
    parts: int,
    drive: Drive,
    limits: Sequence[float],
    start: Goal,
) -> Float[np.ndarray, "part 2"]:
    """Goals and rates at the end of each part of held commands, (n · parts, 2).

    Args:
        u: commands, (n,).
        dt: how long each is held [s].
        parts: into how many steps that is divided.
        drive: whose command it is.
        limits: of speed and acceleration, of the joint [rad/s], [rad/s²].
        start: where the goal begins.
    """
    speed, acceleration = (abs(drive.gear) * x for x in limits)
    return profiled(np.repeat(u, parts), dt / parts, speed, acceleration, start)
