"""Ranges in which ``wt.prove.sysid_rival`` looks for a parameter, and its starts.

The ranges are those of an engineer who knows the model and has looked at the recordings: what adds
to something of the model's own may also take it away, and no loss needs more than the largest
torque that there was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float

from wt.errors import ConfigError, suggest
from wt.physics.effect import Effect, effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.types import Location

Free = tuple[str, str]
"""An effect to be fitted: its id, and the name of its joint or actuator."""


@dataclass(frozen=True, eq=False)
class Freed:
    """An effect whose parameters are free.

    Attributes:
        effect: the effect.
        at: its place.
        lower: least parameters; negative for those of which the model has too much.
        upper: largest parameters.
        nominal: those of the model as it is.
    """

    effect: Effect
    at: Location
    lower: Float[np.ndarray, " theta"]
    upper: Float[np.ndarray, " theta"]
    nominal: Float[np.ndarray, " theta"]

    @property
    def share(self) -> Float[np.ndarray, " theta"]:
        """The nominal parameters as shares of their ranges."""
        return np.asarray((self.nominal - self.lower) / (self.upper - self.lower))


def planted(freed: Sequence[Freed], shares: Float[np.ndarray, " parameter"]) -> tuple[Planted, ...]:
    """The effects with their parameters, from shares of all ranges."""
    left = iter(shares)
    return tuple(
        Planted(f.effect, f.at, f.lower + (f.upper - f.lower) * list(islice(left, len(f.lower))))
        for f in freed
    )


def all_freed(motion: Motion, parameters: Sequence[Free]) -> tuple[Freed, ...]:
    """Effects with ranges that suit a motion.

    Raises:
        ConfigError: there are no ranges for an effect, no such place in the model, or one is free
            twice.
    """
    if len(set(parameters)) < len(parameters):
        said = ", ".join(f"{name} at {place}" for name, place in parameters)
        raise ConfigError(f"a parameter is free twice among {said}; name it once")
    return tuple(_freed(motion, name, place) for name, place in parameters)


def _freed(motion: Motion, name: str, place: str) -> Freed:
    if name not in RANGES:
        raise ConfigError(
            f"{name!r} cannot be fitted with mujoco.sysid here; {suggest(name, RANGES)}"
        )
    effect = effects()[name]
    places = {at.name: at for at in effect.places(motion.scene)}
    if place not in places:
        raise ConfigError(f"{name} has no place {place!r} in the model; {suggest(place, places)}")
    ranges = RANGES[name](motion, place)
    lower, upper, nominal = np.transpose([np.array(r, dtype=float) for r in ranges])
    return Freed(effect, places[place], lower, upper, nominal)


Range = tuple[float, float, float]
"""Lowest, highest and nominal value of a parameter that adds to the model's own."""


def _armature(motion: Motion, joint: str) -> list[Range]:
    dof = motion.scene.dof(joint)
    own = float(motion.scene.model.dof_armature[dof])
    return [(-own, _effort(motion, dof) / max(_rms(motion.a[:, dof]), 0.5), 0.0)]


def _damping(motion: Motion, joint: str) -> list[Range]:
    dof = motion.scene.dof(joint)
    own = float(np.ravel(motion.scene.model.dof_damping[dof])[0])
    return [(-own, _effort(motion, dof) / max(_rms(motion.v[:, dof]), 0.05), 0.0)]


def _frictionloss(motion: Motion, joint: str) -> list[Range]:
    dof = motion.scene.dof(joint)
    own = float(motion.scene.model.dof_frictionloss[dof])
    return [(-own, _effort(motion, dof), 0.0)]


def _spring(motion: Motion, joint: str) -> list[Range]:
    dof = motion.scene.dof(joint)
    q = motion.q[:, dof]
    middle = float(q.mean())
    stiffest = _effort(motion, dof) / max(float(q.std()), 0.05)
    return [(0.0, stiffest, 0.0), (float(q.min()) - np.pi, float(q.max()) + np.pi, middle)]


def _gain(motion: Motion, actuator: str) -> list[Range]:
    return [(0.1, 5.0, 1.0)]


RANGES: dict[str, Callable[[Motion, str], list[Range]]] = {
    "joint.armature": _armature,
    "joint.friction_viscous": _damping,
    "joint.friction_coulomb": _frictionloss,
    "joint.stiffness": _spring,
    "actuator.gain": _gain,
}
"""For every effect that can be fitted, the ranges of its parameters at a place."""


def _effort(motion: Motion, dof: int) -> float:
    """The largest torque at a joint: no loss can be larger [N·m]."""
    torques = np.stack([motion.drive_forces[:, dof], motion.demand[:, dof]])
    return max(float(np.abs(torques).max()), 1e-6)


def _rms(signal: Float[np.ndarray, " sample"]) -> float:
    return float(np.sqrt(np.mean(signal**2)))
