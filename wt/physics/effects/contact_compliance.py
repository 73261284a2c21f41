"""A foot or a floor that gives more than the model says."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.contact import deciding, fixed, outrank, partners, touchable, unlike
from wt.physics.effect import Parameter, register
from wt.physics.motion import Motion
from wt.physics.parts import compiled
from wt.physics.replay_only import ReplayOnly
from wt.physics.scene import Scene
from wt.physics.units import HINGE, Units
from wt.types import Location

_SOFTER = (2.0, 4.0)  # times the model's own, to start from
_UNLIKE = 0.35  # of the logarithm


@register
class ContactCompliance(ReplayOnly):
    """The time constant of a geom's contacts, critically damped, or of the ground's under all.

    How far a foot sinks in is below what tracks a base, and forces do not show it at all: only
    replays tell.
    """

    id = "contact.compliance"
    kind = "geom"
    parameters = (Parameter("time_constant", "s", 2e-3, 1.0, 5e-4),)
    reference = "MuJoCo documentation, Modeling, Solver parameters"

    def places(self, scene: Scene) -> Sequence[Location]:
        """Named geoms that may touch: of the machine, and fixed ones."""
        return touchable(scene)

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """Softer than the model, where anything ever comes near anything."""
        if not motion.touching.near.any():
            return []
        own = float(motion.scene.model.geom(at.name).solref[0])
        return [np.array([factor * own]) for factor in _SOFTER if own > 0.0]

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Tell whether it is further from the model's than soles and floors are from each other."""
        m = motion.scene.model
        now = m.geom_solref[deciding(m, m.geom(at.name).id), 0]
        return unlike(float(theta[0]), now, _UNLIKE)

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Write ``solref``, and see to it that no partner has a say in it.

        Of two geoms the one of higher priority decides, of equals the mean.
        """
        model = compiled(spec)
        own, mine = model.geom(at.name).id, spec.geom(at.name)
        solref = [float(theta[0]), 1.0]
        mine.solref = solref
        for partner in partners(model, own):
            other, over = spec.geoms[partner], model.geom_priority[partner] - mine.priority
            if fixed(model)[own] and over >= 0:
                other.solref = solref  # whatever stands on this ground gives as it does
            elif over >= 0:
                # friction goes on being what it was: of equals the larger one
                rough = np.maximum(mine.friction, other.friction) if over == 0 else other.friction
                mine.friction = rough
                outrank(mine, other)

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        return f"Contacts of {at.name} give with a time constant of {1e3 * theta[0]:.3g} ms."

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"quick squats and hops with the whole weight on {at.name}"
