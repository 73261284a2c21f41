"""A drive that weakens as it warms up."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from wt.physics.driving import driven, force_of, sides_of
from wt.physics.effect import LEAST, Parameter, Shape, register
from wt.physics.hooks import FromRecordings, OnSteps
from wt.physics.live import Law, Live, Values
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_HOTTEST = 1.5  # heat beyond which a motor's protection would step in
_SMALLER = (0.85, 0.7, 0.5)  # shares of the load in the recordings


@Law
def _lost(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    loss, tau, rated, usual = theta[0], theta[1], own[1], own[2]
    force = force_of(own, 3, q, v, u)
    if math.isnan(own[0]):  # what came before is taken as the load in the recordings
        own[0] = -math.expm1(-t / tau) * ((usual / rated) ** 2 if usual else 1.0)
    lost = loss * min(own[0], _HOTTEST) * force
    load = (force / rated) ** 2 if usual else 1.0
    own[0] -= math.expm1(-h / tau) * (load - own[0])
    return -lost


@register
class ActuatorFade(FromRecordings, OnSteps):
    """τ → τ · (1 − loss · x) with heat x: time_constant · ẋ = (τ/τ₀)² − x, cold at the start.

    τ₀ is the root mean square of the drive's force in the recordings, read off them, so that the
    whole ``loss`` shows when the motion that was recorded goes on; or less, where the motor is as
    hot as it gets, and τ₀ is fitted (:class:`_Hot`).
    """

    id = "actuator.fade"
    kind = "actuator"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss", "-", 0.0, 0.95, 1e-3, neutral=0.0, inexact=0.03),
        Parameter("time_constant", "s", 2.0, 1e4, 1e-2, inexact=0.03),
    )
    reference = "J. Pyrhönen et al., Design of Rotating Electrical Machines, chapter 9"
    native = False
    signed = (1,)
    read_off = 1
    looks_like = ("weak drive",)
    plotted_over = "time"

    def __init__(self, usual: float = 0.0) -> None:
        """Bind τ₀ [N·m]; zero where it is not known, and then the load is taken as the usual."""
        self.usual = usual

    def shaped(self, shape: Shape) -> ActuatorFade:
        """The effect bound to the load in the recordings; hot, if the shape has another τ₀."""
        bound = copy.copy(self) if len(shape) == 2 else _Hot()
        bound.usual = float(shape[-1])
        return bound

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Time constants as fractions of the recording's length, and the load in the recordings.

        In front of it a smaller τ₀ too, where the heat that it makes reaches what a motor stands:
        strength that falls no further in a stronger motion tells them apart.
        """
        times = self._times(motion)
        if self.usual:
            return [(time, self.usual) for time in times]
        force = motion.force(motion.scene.drive(at.name))
        usual = float(np.sqrt(np.mean(force**2)))
        smaller = [(time, share * usual, usual) for share in _SMALLER for time in times]
        hot = [shape for shape in smaller if _heat(motion, force, shape).max() >= _HOTTEST]
        return [*((time, usual) for time in times), *hot]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """The force that is lost, per unit of loss."""
        drive = motion.scene.drive(at.name)
        force = motion.force(drive)
        return motion.on(drive.dof, -force * _heat(motion, force, shape))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """(loss, time constant), and τ₀ where it is fitted."""
        return np.array([coefficients[0], *shape[:-1]])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """The final strength as gain: the closest that a servo's element offers."""
        actuator = spec.actuator(at.name)
        actuator.gainprm = np.array(actuator.gainprm) * (1.0 - theta[0])
        actuator.biasprm = np.array(actuator.biasprm) * (1.0 - theta[0])

    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """Take the lost force off."""
        cold = np.full(len(at), np.nan)
        own = np.column_stack([cold, self._load(theta), np.full(len(at), self.usual)])
        return Live(_lost, sides_of(scene, at), theta, np.hstack([own, driven(scene, at)]))

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Take the lost force off, with the heat as a hidden state."""
        loss, tau, rated = theta[0], theta[1], float(self._load(theta))
        power = (self.usual / rated) ** 2 if self.usual else 1.0
        name = f'"{at.name} heat"'
        load = f"(drive / {number(rated)}) ** 2" if self.usual else "1.0"
        force = (
            f'drive, dof = self._drive("{at.name}", qpos, qvel, ctrl)',
            f"heat = self._state({name}, -{number(power)} * np.expm1(-t / {number(tau)}))",
            f"f[:, dof] -= {number(loss)} * np.minimum(heat, {_HOTTEST}) * drive",
            f"self._next[{name}] = heat - np.expm1(-h / {number(tau)}) * ({load} - heat)",
        )
        return Script(force=force, helpers=("drive",))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        usual = float(self._load(theta))
        load = f" of {usual:.3g} {units.force}" if usual else ""
        return (
            f"Actuator {at.name} loses {100.0 * theta[0]:.3g} % of its strength as it warms up "
            f"under its usual load{load}, with a time constant of {theta[1]:.3g} s."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"the same motion of {at.name} from cold, repeated for several minutes"

    def _times(self, motion: Motion) -> list[float]:
        """Time constants to try [s]."""
        return [float(f * motion.t.max()) for f in (0.1, 0.25, 0.5, 1.0, 2.0)]

    def _load(self, theta: Float[np.ndarray, "*replay parameter"]) -> Float[np.ndarray, "*replay"]:
        """τ₀ of (…, n_theta) parameters [N·m]."""
        return np.full(theta.shape[:-1], self.usual)


class _Hot(ActuatorFade):
    """As hot as a motor gets: when it is so depends on τ₀, which is one more parameter."""

    parameters = (
        *ActuatorFade.parameters,
        Parameter("load", "N·m", LEAST, 1e8, 1e-3, public=False),
    )

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Time constants, τ₀, and the load in the recordings."""
        times, loads = self._times(motion), [share * self.usual for share in _SMALLER]
        return [(time, load, self.usual) for load in loads for time in times]

    def _load(self, theta: Float[np.ndarray, "*replay parameter"]) -> Float[np.ndarray, "*replay"]:
        return theta[..., 2]


def _heat(
    motion: Motion, force: Float[np.ndarray, " sample"], shape: Shape
) -> Float[np.ndarray, " sample"]:
    """Heat along a motion, (T,); before a segment, the load is that in the recordings."""
    heat, tau, rated, usual = np.empty(len(motion)), shape[0], shape[1], shape[-1]
    power = (usual / rated) ** 2 if usual else 1.0
    for s in motion.segments:
        keep = float(np.exp(-s.dt / tau))
        load = (force[s.rows] / rated) ** 2 if usual else np.ones(s.rows.stop - s.rows.start)
        start = -float(np.expm1(-motion.t[s.rows.start] / tau)) * power
        before = np.concatenate([[start], (1.0 - keep) * load[:-1]])
        heat[s.rows] = lfilter([1.0], [1.0, -keep], before)
    return np.minimum(heat, _HOTTEST)
