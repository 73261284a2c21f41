"""A weight inside a body that moves: a ball in a box, a load on rails, a liquid."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import carried, place_of_load, point_load
from wt.physics.hooks import Beyond, FromRecordings, Intervals, Nested, Stateful
from wt.physics.loose import Centre, LooseLaw, columns, path_of
from wt.physics.loose_search import laws_that_fit, likeliest_laws
from wt.physics.motion import Motion
from wt.physics.parts import add_joint
from wt.physics.replay import Hidden, Stretch
from wt.physics.units import HINGE, Units
from wt.types import Location

_AXES = ("x", "y", "z")
_STOP = (0.006, 1.0)  # time constant [s] and damping ratio: nothing bounces
_AT_REST = 0.003  # m: what moves less is fixed
_SPRUNG = 1.0  # 1/s²
_UNSURE, _UNSURE_V = 0.15, 0.15
"""Deviation of a path from the load's own: a share of the travel, and of its speed [m/s]."""


@register
class BodyPayloadMoving(FromRecordings, Nested, Stateful):
    """A point mass on slides along the body's axes, damped, between stops.

    Along which axes, how far along each against the longest, damping, spring and whether it rolls
    are no part of ``theta``: they stand in the signature's shape, with the centre at which it was
    computed, and are read off the residual (:mod:`wt.physics.loose_search`). No path is exact, and
    a load that is not quite where it is thought to be weighs less in a fit; so all weight that is
    too much counts as its own, and none as an error of the body's mass. What really moves may be a
    ball or a liquid, hence intervals as wide as ``inexact`` says.
    """

    id = "body.payload_moving"
    kind = "body"
    parameters = (
        Parameter("mass", "kg", 0.0, 1e6, 1e-3, inexact=0.15),
        Parameter("travel", "m", 1e-3, 2.0, 1e-3, inexact=0.25),
        Parameter("position", "m", -5.0, 5.0, 1e-3, _AXES, prior_std=0.1),
    )
    reference = "H. N. Abramson, The dynamic behavior of liquids, NASA SP-106, 1966, chapter 6"
    excludes = ("body.payload_fixed",)
    reads_residual = True
    signed = (1, 0, 0, 0)
    read_off = 10
    odds_against = 8.0
    settles = ("body.mass",)
    looks_like = ("weight",)
    plotted_over = "time"

    def __init__(self, shape: Shape = ()) -> None:
        """Bind travel x, y, z; damping, spring, rolling; centre x, y, z; mass."""
        self.shape = shape

    def shaped(self, shape: Shape) -> BodyPayloadMoving:
        """The effect bound to a law."""
        bound = copy.copy(self)
        bound.shape = tuple(shape)
        return bound

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Laws under which the load would have been where the residual says that it was."""
        if self.shape:
            return [self.shape]
        return [
            (*law.travel, law.damping, law.spring, law.rolling, *centre, mass)
            for law, centre, mass in laws_that_fit(motion, at.name)
        ]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force per kilogram, and per kg·m away from the centre of the shape."""
        centre = _centre(shape)
        path = path_of(motion, at.name, centre, _law(shape))
        return columns(motion, at.name, centre, path)

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Mass, the longest travel, and position from the first moments."""
        place = place_of_load(coefficients, _centre(shape))
        return np.array([coefficients[0], max(shape[:3]), *place])

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """The load that was read off, none of it put down to a model's usual error of mass."""
        if not self.shape:
            return []
        return [np.array([self.shape[9], max(self.shape[:3]), *_centre(self.shape)])]

    def beyond(
        self, motion: Motion, at: Location, law: str, theta: Float[np.ndarray, " smaller"]
    ) -> Sequence[Beyond]:
        """The load that seems fixed, under the laws that forces are least against.

        Forces may be too noisy for a law to be read off, and replays still tell.
        """
        if law != "body.payload_fixed":
            return []
        mass, *centre = (float(x) for x in theta)
        x, y, z = centre
        return [
            (
                (*law.travel, law.damping, law.spring, law.rolling, x, y, z, mass),
                np.array([mass, max(law.travel), x, y, z]),
            )
            for law in likeliest_laws(motion, at.name, (x, y, z))
        ]

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """The same load fixed, where it may travel as little as one that is."""
        if np.min(intervals["travel"][0]) > _AT_REST:
            return None
        return "body.payload_fixed", theta[[0, 2, 3, 4]]

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Put a point mass on slides between stops."""
        mass, law = float(theta[0]), self._law(theta)
        payload = point_load(spec, at.name, mass, theta[2:])
        if payload is None:
            return
        for axis, letter, travel in zip(np.eye(3), _AXES, law.travel, strict=True):
            if travel > 0.0:
                add_joint(
                    spec,
                    payload,
                    f"{payload.name}_{letter}",
                    type=mujoco.mjtJoint.mjJNT_SLIDE,
                    axis=axis,
                    limited=mujoco.mjtLimited.mjLIMITED_TRUE,
                    range=[-0.5 * travel, 0.5 * travel],
                    solref_limit=_STOP,
                    damping=[mass * law.damping, 0.0, 0.0],
                    stiffness=[mass * law.spring, 0.0, 0.0],
                    armature=mass * law.rolling,
                )

    def started(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, Hidden]:
        """State that the load had reached, from how the body had moved until then."""
        law = self._law(theta)
        s, v = np.zeros((2, 3))
        if stretch.motion is not None and stretch.segment is not None:
            path = path_of(stretch.motion, at.name, self._centre(theta), law)
            rows, now = stretch.segment.rows, stretch.t[0]
            t = stretch.motion.t[rows]
            s = np.array([np.interp(now, t, path.s[rows, k]) for k in range(3)])
            v = np.array([np.interp(now, t, path.v[rows, k]) for k in range(3)])
        return {
            f"{at.name}_payload_{axis}": Hidden(float(x), float(y), (_UNSURE * travel, _UNSURE_V))
            for axis, travel, x, y in zip(_AXES, law.travel, s, v, strict=True)
            if travel > 0.0
        }

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Tell whether the body can carry it there, and it moved at all."""
        if not carried(motion.scene, at.name, float(theta[0]), theta[2:]):
            return False
        path = path_of(motion, at.name, self._centre(theta), self._law(theta))
        return bool(np.std(path.s, axis=0).max() > _AT_REST)

    def observed(self) -> Mapping[str, tuple[str, tuple[float, ...]]]:
        """The law it moves by: shares of the longest travel along x, y and z, and what holds it."""
        if not self.shape:
            return {}
        law = _law(self.shape)
        longest = max(law.travel)
        return {
            "shares": ("-", tuple(x / longest for x in law.travel)),
            "damping": ("1/s", (law.damping,)),
            "frequency": ("rad/s", (float(np.sqrt(law.spring)),)),
            "rolling": ("-", (law.rolling,)),
        }

    def _law(self, theta: Float[np.ndarray, " parameter"]) -> LooseLaw:
        """The bound law with another travel."""
        if not self.shape:  # nothing read off yet: free along x
            return LooseLaw((float(theta[1]), 0.0, 0.0), 1.0, 0.0, 0.0)
        law = _law(self.shape)
        scale = float(theta[1]) / max(law.travel)
        x, y, z = (scale * travel for travel in law.travel)
        return LooseLaw((x, y, z), law.damping, law.spring, law.rolling)

    def _centre(self, theta: Float[np.ndarray, " parameter"]) -> Centre:
        """The bound centre: where exactly it is matters little to a path, and each costs time."""
        x, y, z = self.shape[6:9] or (float(x) for x in theta[2:])
        return (x, y, z)

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        law = self._law(theta)
        how = "sloshes" if law.spring > _SPRUNG else "rolls" if law.rolling > 0.0 else "slides"
        axes = " and ".join(a for a, x in zip(_AXES, law.travel, strict=True) if x > 0.0)
        x, y, z = 1e3 * theta[2:]
        return (
            f"Body {at.name} carries a load of {theta[0]:.3g} kg that {how} over "
            f"{1e3 * theta[1]:.3g} mm along its {axes}, around {x:.3g}, {y:.3g}, {z:.3g} mm "
            "(x, y, z of the body)."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"{at.name} tilted slowly both ways, then shaken and stopped"


def _law(shape: Shape) -> LooseLaw:
    x, y, z, damping, spring, rolling = shape[:6]
    return LooseLaw((x, y, z), damping, spring, rolling)


def _centre(shape: Shape) -> Centre:
    x, y, z = shape[6:9]
    return (x, y, z)
