"""Sliding friction between the machine and what it touches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.physics.contact import deciding, fixed, loads, outrank, partners, touchable, unlike
from wt.physics.effect import Parameter, register
from wt.physics.motion import Motion
from wt.physics.parts import compiled
from wt.physics.replay_only import ReplayOnly
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_SLIPPING, _LOADED = 0.06, 0.08  # m/s; share of the weight: less is noise of the residual
_LEAST, _THINNED = 20, 5  # samples that must slip; one in so many is looked at
_STARTS = (0.75, 0.5)  # quantiles of what was seen: a foot that hardly slips shows less
_UNLIKE = 0.25  # of the logarithm: a dusty floor is no finding


@register
class ContactFriction(ReplayOnly):
    """A coefficient of sliding friction of one geom, or of the ground under all.

    No force signature tells it, since contact forces are projected out of the residual; how far
    what the contacts carry leans back while they slip says where to start.
    """

    id = "contact.friction"
    kind = "geom"
    parameters = (Parameter("friction", "-", 0.01, 3.0, 1e-3),)
    reference = "C. A. de Coulomb, Théorie des machines simples, 1785"
    plotted_over = "velocity"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Named geoms that may touch: of the machine, and fixed ones."""
        return touchable(scene)

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """Friction that slipping contacts show."""
        geom = motion.scene.model.geom(at.name).id
        geoms, friction = _seen(motion)
        mine = friction[(geoms == geom).any(axis=1)]
        if len(mine) < _LEAST:
            return []
        lower, upper = self.bounds()
        return [np.clip([np.quantile(mine, q)], lower, upper) for q in _STARTS]

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Tell whether it is further from the model's than floors are from each other."""
        m = motion.scene.model
        now = m.geom_friction[deciding(m, m.geom(at.name).id), 0]
        return unlike(float(theta[0]), now, _UNLIKE)

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Write ``friction``, and see to it that no partner overrules it.

        Of two geoms the one of higher priority decides, of equals the larger friction.
        """
        model = compiled(spec)
        own = model.geom(at.name).id
        spec.geom(at.name).friction[0] = theta[0]
        for partner in partners(model, own):
            over = int(model.geom_priority[partner] - model.geom_priority[own])
            if over > 0 or (over == 0 and model.geom_friction[partner, 0] > theta[0]):
                _yield(spec, model, own, partner, float(theta[0]))

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Contacts of {at.name} slide at a friction coefficient of {theta[0]:.3g}."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"pushes and fast turns in which {at.name} slips"


def _yield(spec: mujoco.MjSpec, model: mujoco.MjModel, own: int, partner: int, mu: float) -> None:
    """Let a geom's friction hold against one partner's."""
    if fixed(model)[own]:
        # the ground: whatever stands on it slides as it does
        spec.geoms[partner].friction[0] = mu
        return
    outrank(spec.geoms[own], spec.geoms[partner])


@lru_cache(maxsize=4)
def _seen(motion: Motion) -> tuple[Int[np.ndarray, "contact 2"], Float[np.ndarray, " contact"]]:
    """Contacts that slip under load: their geoms, (n, 2), and the friction of each, (n,)."""
    thinned = slice(None, None, _THINNED)
    m = motion.scene.model
    least = _LOADED * float(np.linalg.norm(m.opt.gravity) * m.body_mass.sum())
    geoms, seen = [np.zeros((0, 2), dtype=int)], [np.zeros(0)]
    parts = (motion.q[thinned], motion.v[thinned], motion.residual[thinned])
    for load in loads(motion.scene, *parts, motion.floors):
        speed = np.linalg.norm(load.slip, axis=1)
        rows = (speed > _SLIPPING) & (load.force[:, 0] > least)
        braking = -np.einsum("ci,ci->c", load.force[rows, 1:], load.slip[rows])
        geoms.append(load.geoms[rows])
        seen.append(braking / speed[rows] / load.force[rows, 0])
    return np.concatenate(geoms), np.concatenate(seen)
