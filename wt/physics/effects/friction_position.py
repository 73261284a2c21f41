"""Dry friction that differs along the way, as of a linkage, a bent screw or an eccentric gear."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Parameter, Shape, register
from wt.physics.effects._bristle import WithDryFriction, brake
from wt.physics.effects._tools import TURN, add_dry_friction
from wt.physics.hooks import Beyond, Intervals, Nested, Parts
from wt.physics.live import Figures, Law, Values, in_laws
from wt.physics.motion import Motion
from wt.physics.script import Script, number
from wt.physics.units import HINGE, Units
from wt.types import Location

_WAVES = (0.125, 0.25, 0.5, 1.0, 2.0, 3.0)
"""Wavelengths to try, as shares of a joint's way: of a longer one too little is seen."""
_LONGEST = 4.0
"""Longest wavelength, as a share of a joint's way: of a longer one less than a quarter is seen, and
its mean and its largest friction are any figures."""
_LEAST = 0.1
"""Rise of friction along the way, as a share of its mean, that is more than an error."""
_NOTHING = 0.01  # of the mean
_BEGUN = 0.3  # depth to start from where plain dry friction was found


@Law
def _along(
    dof: int, q: Values, v: Values, u: Values, t: float, h: float, theta: Values, own: Values
) -> float:
    return brake(theta[0] * _shape(q[dof], theta), v[dof], h, own)


@register
class FrictionPosition(Nested, WithDryFriction):
    """τ = −sign(v) · coulomb · (1 + depth · sin(2π q / wavelength + phase))."""

    id = "joint.friction_position"
    kind = "joint"
    law = _along
    parameters = (
        Parameter("coulomb", "N·m", 0.0, 1e8, 1e-3, neutral=0.0),
        Parameter("depth", "-", 0.0, 1.0, 1e-2, neutral=0.0),
        Parameter("wavelength", "rad", 1e-3, 1e3, 1e-2),
        Parameter("phase", "rad", *TURN, 1e-2, of_joint=False, comes_round=True),
    )
    reference = (
        "B. Armstrong, Friction: experimental determination, modeling and compensation, IEEE "
        "International Conference on Robotics and Automation, 1988"
    )
    native = False
    unites = ("joint.friction_coulomb", "joint.friction_position")
    odds_against = 4.0
    signed = (1, 0, 0)
    looks_like = ("dry friction",)
    each_way = True

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Wavelengths from an eighth of the joint's way to three times that."""
        way = float(np.ptp(motion.q[:, motion.scene.dof(at.name)]))
        return [(share * way,) for share in _WAVES] if way > 0.0 else []

    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """−sign(v), alone and times the sine and the cosine of 2π q / wavelength."""
        dof = motion.scene.dof(at.name)
        against, angle = -np.sign(motion.v[:, dof]), 2.0 * np.pi / shape[0] * motion.q[:, dof]
        return motion.on(dof, against, against * np.sin(angle), against * np.cos(angle))

    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Friction on average, depth, wavelength and phase."""
        mean, sine, cosine = coefficients
        depth = np.hypot(sine, cosine) / max(abs(mean), 1e-12)
        return np.array([mean, depth, shape[0], np.arctan2(cosine, sine)])

    def patch(
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Stand-in: ``frictionloss`` of what it is on average."""
        if theta[0] > 0.0:
            add_dry_friction(spec, at.name, float(theta[0]))

    def beyond(
        self, motion: Motion, at: Location, law: str, theta: Float[np.ndarray, " smaller"]
    ) -> Sequence[Beyond]:
        """Coulomb's friction, some more of it at either end of the way or in its middle."""
        if law != "joint.friction_coulomb":
            return []
        q = motion.q[:, motion.scene.dof(at.name)]
        middle, wave = 0.5 * float(q.min() + q.max()), 2.0 * float(np.ptp(q))
        ahead = -2.0 * np.pi * middle / wave
        phases = [np.arctan2(np.sin(ahead + x), np.cos(ahead + x)) for x in np.pi * np.arange(2)]
        return [((wave,), np.array([theta[0], _BEGUN, wave, phase])) for phase in phases]

    def union(
        self, motion: Motion, at: Location, parts: Parts
    ) -> Float[np.ndarray, " parameter"] | None:
        """The same wave about more friction, or less, is less deep, or deeper."""
        theta = super().union(motion, at, parts)
        if theta is None or theta[0] == 0.0:
            return None
        theta[1] *= parts[self.id, at][0] / theta[0]
        return theta if theta[1] <= 1.0 else None

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Without a rise along the way it is plain dry friction; of a wave a part must be seen."""
        q = motion.q[:, motion.scene.dof(at.name)]
        level, seen = _shape(q, theta), theta[2] <= _LONGEST * np.ptp(q)
        return bool(seen and np.ptp(level) > _LEAST * np.mean(level))

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """It is less here and there, and never nothing."""
        level = _shape(motion.q[:, motion.scene.dof(at.name)], theta)
        if np.min(level) > _NOTHING * np.mean(level):
            return None
        return "friction would vanish on the way: what grips at one place alone is another law's"

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """Coulomb's, where it may be the same everywhere."""
        if np.min(intervals["depth"][0]) > 0.0:
            return None
        level = _shape(motion.q[:, motion.scene.dof(at.name)], theta)
        return "joint.friction_coulomb", theta[:1] * float(np.mean(level))

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script:
        """Friction by an elastic bristle that slips."""
        coulomb, depth, wave, phase = map(number, (*theta[:2], 2.0 * np.pi / theta[2], theta[3]))
        level = (
            f'q, _, dof = self._joint("{at.name}", qpos, qvel)',
            f"level = {coulomb} * (1.0 + {depth} * np.sin({wave} * q + {phase}))",
        )
        return self.slipping(at, level, "joint")

    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """See :meth:`Effect.statement`."""
        most = theta[2] * (0.25 - theta[3] / (2.0 * np.pi))
        return (
            f"Joint {at.name} loses {theta[0] * (1.0 - theta[1]):.3g} to "
            f"{theta[0] * (1.0 + theta[1]):.3g} {units.force} to dry friction, which is largest at "
            f"{most:.3g} {units.position} and every {theta[2]:.3g} {units.position} from there."
        )

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """See :meth:`Effect.separation`."""
        return f"one slow speed of {at.name} over all of its range, in both directions"


@in_laws
def _shape(q: Figures, theta: Values) -> Figures:
    """Friction at some positions, over what it is on average."""
    along: Figures = 1.0 + theta[1] * np.sin(2.0 * np.pi * q / theta[2] + theta[3])
    return along
