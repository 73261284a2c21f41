"""A weight that the model does not know, fixed to a body."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics import inertia
from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._tools import carried, place_of_load, point_load
from wt.physics.hooks import Intervals, Linearised, Nested, Parts, Uniting
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_ORIGIN = (0.0, 0.0, 0.0)
_APART = 0.1  # m; the moments are quadratic in the position, so any central difference is exact


@register
class BodyPayloadFixed(Linearised, Nested, Uniting):
    """A point mass at a position in the body's frame.

    Its force is m·(f₀ + f₁·p + pᵀ·f₂·p). The signature is linear in m and m·(p − shape): the
    derivative at the position that the shape names, the body's centre of mass at first. Seen from
    there a load that sits elsewhere has the wrong inertia, which its mass makes up for: the screen
    goes on to the position that it finds.
    """

    id = "body.payload_fixed"
    kind = "body"
    parameters = (
        Parameter("mass", "kg", 0.0, 1e6, 1e-3),
        Parameter("position", "m", -5.0, 5.0, 1e-3, ("x", "y", "z"), prior_std=0.1),
    )
    reference = "C. H. An, C. G. Atkeson and J. M. Hollerbach, Model-Based Control of a Robot, 1988"
    signed = (1, 0, 0, 0)
    looks_like = ("weight",)
    common = "often"
    unites = ("body.mass", "body.com", "body.inertia", id)

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """The centre of mass: at the frame's origin a body that turns about it shows no mass."""
        x, y, z = motion.scene.model.body(at.name).ipos
        return [(float(x), float(y), float(z))]

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Force per kilogram at the shape's position, and per kg·m away from it."""
        there, point = np.array(shape), np.zeros((3, 3))
        ahead, behind = (
            [inertia.parameters(1.0, there + e, point) for e in sign * _APART * np.eye(3)]
            for sign in (1.0, -1.0)
        )
        slopes = (np.array(ahead) - np.array(behind)) / (2.0 * _APART)
        columns = np.vstack([inertia.parameters(1.0, there, point), slopes])
        return -inertia.demand(motion, at.name) @ columns.T

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Mass, and position from the first moments."""
        return np.array([coefficients[0], *place_of_load(coefficients, shape)])

    def around(self, theta: Float[np.ndarray, " parameter"]) -> Shape:
        """The position of the load."""
        x, y, z = theta[1:]
        return (float(x), float(y), float(z))

    def near(self, scene: Scene, at: Location) -> tuple[Location, ...]:
        """The bodies beside it: a load on one of them is felt as a part of it on the other."""
        if at.name not in scene.moving:  # all of them at once
            return ()
        m, here = scene.model, scene.model.body(at.name).id
        beside = [b for b in range(1, m.nbody) if here == m.body_parentid[b]]
        names = [m.body(int(b)).name for b in (m.body_parentid[here], *beside)]
        return tuple(Location("body", name) for name in names if name in scene.moving)

    def union(
        self, motion: Motion, at: Location, parts: Parts
    ) -> Float[np.ndarray, " parameter"] | None:
        """The load that adds as much mass and first moment; none where mass is missing."""
        here, (mass, moment) = motion.point(at.name, _ORIGIN), _added(motion.scene, at, parts)
        for place in {place for _, place in parts} - {at}:
            there = motion.point(place.name, _ORIGIN)
            more, moved = _added(motion.scene, place, parts)
            lever = more * (there.x - here.x) + there.rotation @ moved
            mass += more
            moment = moment + np.einsum("tji,tj->i", here.rotation, lever) / len(lever)
        return np.array([mass, *(moment / mass)]) if mass > 0.0 else None

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Tell whether the body can carry it there."""
        return carried(motion.scene, at.name, float(theta[0]), theta[1:])

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """A centre of mass that is elsewhere, where only that shows, and no weight."""
        if np.min(intervals["mass"][0]) > 0.0:
            return None
        model, mass = motion.scene.model, inertia.own(motion.scene, at.name)[0]
        first = int(model.body(at.name).jntadr[0])
        pivot = model.jnt_pos[first] if first >= 0 else np.zeros(3)
        return None if mass <= 0.0 else ("body.com", theta[0] / mass * (theta[1:] - pivot))

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Weld a point mass on."""
        point_load(spec, at.name, float(theta[0]), theta[1:])

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        x, y, z = 1e3 * theta[1:]
        return (
            f"Body {at.name} carries {theta[0]:.3g} kg that the model does not know, at "
            f"{x:.3g}, {y:.3g}, {z:.3g} mm (x, y, z of the body)."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"a multisine on all joints that carry {at.name}, at poses with and without weight"


def _added(scene: Scene, at: Location, parts: Parts) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Mass [kg] and first moment in the body's frame [kg·m] that effects of a body add to it."""
    mass, centre, _ = inertia.own(scene, at.name)
    factor = float(parts.get(("body.mass", at), np.ones(1))[0])
    shift = parts.get(("body.com", at), np.zeros(3))
    load = parts.get(("body.payload_fixed", at), np.zeros(4))
    added = (factor - 1.0) * mass
    # (factor · mass) (centre + shift) = mass · centre + moment
    return added + float(load[0]), added * centre + factor * mass * shift + load[0] * load[1:]
