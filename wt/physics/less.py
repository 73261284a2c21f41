"""Laws that a model may have too much of: friction that was guessed, a rotor of another gear.

What a model has of such a law can be taken away, at most all of it; more can be added without end.
"""

from __future__ import annotations

import abc
import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import cast

from wt.physics.effect import Effect, Shape, effects
from wt.physics.hooks import FromRecordings
from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.types import Location


class OrLess(FromRecordings):
    """An effect of one parameter that adds to what the model has, or takes away from it.

    The shape () adds. The shape of one figure, which is how much the model has, binds the effect
    to that: its parameter is negative then, and −own is nothing left.
    """

    read_off = 1
    _own: float | None = None

    @abc.abstractmethod
    def has(self, scene: Scene, at: Location) -> float:
        """How much of it the model has at a place, in the unit of the parameter."""

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """More of it, and less where the model has any."""
        own = self.has(motion.scene, at)
        return [(), (own,)] if own > 0.0 else [()]

    def shaped(self, shape: Shape) -> Effect:
        """Less of what the model has, where that is how much it has."""
        return less(self.id, *shape) if shape else self

    def __reduce__(self) -> tuple[object, ...]:
        """One for each size, in every process."""
        return (type(self), ()) if self._own is None else (less, (self.id, self._own))


@cache
def less(name: str, own: float) -> Effect:
    """The effect of that id where a model has too much of it.

    What of it is an error of any model is part of it: both together would be more than all.

    Args:
        name: id of an effect.
        own: how much the model has, in the unit of the parameter.
    """
    effect = copy.copy(cast(OrLess, effects()[name]))
    (added,) = effect.parameters
    taken = replace(added, lower=-own, upper=0.0, all_there_is=True)
    # of this one instead of the class's
    vars(effect).update(parameters=(taken,), signed=(-1,), settles=(name,), _own=own)
    return effect
