"""A position drive whose firmware moves its goal towards the command with a limited speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import LEAST, Parameter, Shape, register
from wt.physics.hooks import OnGoals, Remembering
from wt.physics.motion import Motion
from wt.physics.replay import Inputs, Stretch
from wt.physics.scene import Drive, Scene
from wt.physics.servos import as_pid, fastest, sent, servos, slewed
from wt.physics.units import HINGE, Units
from wt.types import Location

_TRIED = (0.5, 0.75, 0.9, 1.0)
"""Shares of a joint's fastest motion that are tried as its goal's: a servo overshoots a little."""
_PASSED = 1.02
"""A command that is faster than the goal by less than this share may as well be reached."""


@register
class ActuatorSlewRate(Remembering, OnGoals):
    """g → u with |dg/dt| ≤ speed, and the drive goes to g."""

    id = "actuator.slew_rate"
    kind = "actuator"
    parameters = (Parameter("speed", "rad/s", LEAST, 1e6, 1e-3),)
    reference = "MuJoCo XML reference, actuator/pid/slewmax"
    signed = (1,)
    excludes = ("actuator.lag", "actuator.profile")
    looks_like = ("delay",)
    plotted_over = "velocity"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Drives that follow a position as it is sent."""
        return servos(scene)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Speeds around the joint's fastest, where the command is ever faster."""
        drive = motion.scene.drive(at.name)
        most, sends = fastest(motion, drive), _fastest_sent(motion, drive)
        return [(s,) for f in _TRIED if (s := f * most) * _PASSED < sends and s > 0.0]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force under the limited goal minus force under the command as sent."""
        drive = motion.scene.drive(at.name)
        speed, late = shape[0] * abs(drive.gear), np.empty(len(motion))
        for s in motion.segments:
            u = np.clip(motion.command[s.rows, drive.index], *drive.commands)
            late[s.rows] = _mean_around(u, s.dt, speed)
        change = motion.force(drive, late) - motion.force(drive)
        return motion.on(drive.dof, change)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """The speed, whatever the coefficient: the right one's is 1."""
        return np.array(shape)

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """``slewmax`` of a ``pid`` actuator."""
        actuator = as_pid(spec, at.name)
        actuator.dynprm[1] = theta[0] * abs(actuator.gear[0])

    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Move the goal by as much as it may in each step, as MuJoCo does."""
        drive, first = scene.drive(at.name), inputs.before
        u = np.clip(inputs.u[:, drive.index], *drive.commands)
        speed, start = theta[0] * abs(drive.gear), float(u[first])
        if inputs.stretch is not None:
            start = _begin(inputs.stretch, drive, speed)
        inputs.u[first:, drive.index] = slewed(u[first:], inputs.h, speed, start)

    def remembered(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, float]:
        """The goal."""
        if stretch.motion is None:
            return {}
        drive = stretch.motion.scene.drive(at.name)
        return {f"{at.name} goal": _begin(stretch, drive, theta[0] * abs(drive.gear))}

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return (
            f"Actuator {at.name} moves its goal towards the command by at most {theta[0]:.3g} "
            f"{units.speed}."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"steps of {at.name}, small and large: the larger one takes longer in proportion"


def _begin(stretch: Stretch, drive: Drive, speed: float) -> float:
    """Where the goal of a drive has got to when a stretch begins."""
    known = sent(stretch, drive)
    goal = float(known.u[0])
    for u, dt in ((known.u[:-1], known.dt), (known.u[-1:], known.last)):
        goal = float(slewed(u, dt, speed, goal)[-1]) if len(u) else goal
    return goal


def _fastest_sent(motion: Motion, drive: Drive) -> float:
    """Fastest that a drive's command moves, of the joint [rad/s]."""
    u = np.clip(motion.command[:, drive.index], *drive.commands)
    rates = [np.abs(np.diff(u[s.rows])).max(initial=0.0) / s.dt for s in motion.segments]
    return float(max(rates, default=0.0)) / abs(drive.gear)


def _mean_around(
    u: Float[np.ndarray, " sample"], dt: float, speed: float
) -> Float[np.ndarray, " sample"]:
    """Mean of a goal over the interval centred on each sample of a held command, (n,)."""
    half, halves = 0.5 * dt, np.repeat(u, 2)
    ends = slewed(halves, half, speed, float(u[0]))
    starts = np.concatenate([u[:1], ends[:-1]])
    # it waits at the command once it is there
    left = np.abs(halves - starts)
    mean = np.where(
        left > speed * half,
        0.5 * (starts + ends),
        halves - np.sign(halves - starts) * left**2 / (2.0 * speed * half),
    )
    before = np.concatenate([mean[:1], mean[1:-1:2]])
    return np.asarray(0.5 * (before + mean[::2]))
