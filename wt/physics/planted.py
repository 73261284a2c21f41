"""An effect at a place with parameters: one part of a hypothesis, as replays need it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.effect import Effect, effects
from wt.physics.hooks import (
    Beyond,
    FromRecordings,
    InReplay,
    Intervals,
    Linearised,
    Nested,
    OnGoals,
    OnInputs,
    OnOutputs,
    Remembering,
    Stateful,
    observed,
)
from wt.physics.motion import Motion
from wt.physics.replay import Hidden, Inputs, Outputs, Stretch
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

_NEAR_LIMIT = 1e-3
"""Of a parameter's range, or of the end itself where it is a factor: so near counts as there."""
Key = tuple[str, str, str]
"""An effect at a place: its id, the place's kind and name."""


@dataclass(frozen=True, eq=False)
class Planted:
    """An effect at a place with parameters: one part of a hypothesis.

    Attributes:
        effect: what.
        at: where.
        theta: its parameters.
    """

    effect: Effect
    at: Location
    theta: Float[np.ndarray, " parameter"]

    def __str__(self) -> str:
        """As in messages."""
        return f"{self.effect.id} at {self.at}"

    def statement(self, scene: Scene) -> str:
        """One plain sentence with figures, in the units of the place."""
        return self.effect.statement(self.at, self.theta, units_at(scene, self.at))

    def separation(self, scene: Scene) -> str:
        """The experiment that tells it best from others at the same place."""
        return self.effect.separation(self.at, units_at(scene, self.at))

    def __reduce__(self) -> tuple[object, ...]:
        """As another process is told of it: without what is only of use here."""
        return type(self), (self.effect, self.at, self.theta)

    @cached_property
    def contents(self) -> bytes:
        """What says the same as this one in this process, as long as its effect lives."""
        what = f"{id(self.effect)} {self.at.kind} {self.at.name}\0{len(self.theta)}\0"
        return what.encode() + self.theta.tobytes()

    @property
    def key(self) -> Key:
        """Identity without the parameters."""
        return (self.effect.id, self.at.kind, self.at.name)

    def possible(self, motion: Motion) -> bool:
        """Tell whether such parameters are this effect, and nothing recorded contradicts it."""
        return self.effect.plausible(motion, self.at, self.theta) and self.wrong(motion) is None

    def wrong(self, motion: Motion) -> str | None:
        """Why it cannot be this effect, in one clause; None if nothing speaks against it."""
        limit = self.at_limit()
        if limit is not None:
            return f"its {limit} is at the end of what is admissible: that is another law's force"
        return self.effect.contradiction(motion, self.at, self.theta)

    def at_limit(self) -> str | None:
        """A parameter that ran to the end of its range, where that is no natural one.

        Natural is where the effect is nothing, where it takes nothing or all (0 and 1, or whatever
        there is), and where angles come round.
        """
        for p, rows in self.effect.rows():
            if p.neutral is None or p.all_there_is or p.comes_round:
                continue
            for end in (p.lower, p.upper):
                natural = end in (0.0, 1.0, max(p.neutral, p.lower))
                near = _NEAR_LIMIT * (abs(end) if p.neutral == 1.0 else p.upper - p.lower)
                if not natural and np.any(np.abs(self.theta[rows] - end) <= near):
                    return p.name
        return None

    # -- what only some effects do -----------------------------------------------------------

    def observed(self) -> Mapping[str, tuple[str, tuple[float, ...]]]:
        """Figures that were read off the recordings instead of fitted: name → (unit, values)."""
        return observed(self.effect)

    def momentary(self) -> bool:
        """Whether it acts at moments that were read off the recordings it is proven on."""
        return isinstance(self.effect, FromRecordings) and self.effect.momentary

    def elsewhere(self, motion: Motion) -> Planted:
        """The same effect in other recordings: what happens at times happens at theirs."""
        if not isinstance(self.effect, FromRecordings):
            return self
        effect, theta = self.effect.elsewhere(motion, self.at, self.theta)
        return replace(self, effect=effect, theta=theta)

    def beside(self, elsewhere: Planted) -> Planted:
        """The same effect with what other recordings show of it, too."""
        if not isinstance(self.effect, FromRecordings):
            return self
        effect, theta = self.effect.beside(self.theta, (elsewhere.effect, elsewhere.theta))
        return replace(self, effect=effect, theta=theta)

    def reach(self) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
        """Smallest and largest step to ask :meth:`moved` for."""
        if isinstance(self.effect, Linearised):
            return self.effect.reach(self.theta)
        lower, upper = self.effect.bounds()
        return lower - self.theta, upper - self.theta

    def moved(self, step: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, " parameter"]:
        """``theta`` after a step, inside the bounds."""
        if isinstance(self.effect, Linearised):
            return self.effect.moved(self.theta, step)
        return np.asarray(np.clip(self.theta + step, *self.effect.bounds()))

    def simpler(self, motion: Motion, intervals: Intervals) -> Planted | None:
        """A law with fewer parameters that is as good, see :meth:`Nested.simpler`."""
        if not isinstance(self.effect, Nested):
            return None
        law = self.effect.simpler(motion, self.at, self.theta, intervals)
        return None if law is None else Planted(effects()[law[0]], self.at, law[1])

    def become(self, motion: Motion) -> Planted | None:
        """The simpler law that it has become, where its parameters are no longer this one."""
        if self.effect.plausible(motion, self.at, self.theta):
            return None
        return self.simpler(motion, {p.name: (p.lower, p.upper) for p in self.effect.parameters})

    def beyond(self, effect: Effect, motion: Motion) -> Sequence[Beyond]:
        """Starting points of a larger law in its place; none, if that does not contain this one."""
        if not isinstance(effect, Nested):
            return []
        return effect.beyond(motion, self.at, self.effect.id, self.theta)

    # -- replay ------------------------------------------------------------------------------

    def model(self, spec: mujoco.MjSpec) -> None:
        """Write into a replay's MJCF what the replay itself does not bring about, in place."""
        if isinstance(self.effect, InReplay):
            self.effect.cleared(spec, self.at)
        else:
            self.effect.patch(spec, self.at, self.theta)

    @property
    def in_model(self) -> bool:
        """Whether the MJCF of a replay is another one with it: most laws a replay brings about."""
        if not isinstance(self.effect, InReplay):
            return True
        return type(self.effect).cleared is not InReplay.cleared

    def followers(self) -> Mapping[str, str]:
        """Joints that the patch adds → the user's joint from whose state each one starts."""
        return self.effect.followers(self.at) if isinstance(self.effect, Stateful) else {}

    def started(self, stretch: Stretch) -> Mapping[str, Hidden]:
        """States that joints of the patch have where a stretch begins."""
        if not isinstance(self.effect, Stateful):
            return {}
        return self.effect.started(self.at, self.theta, stretch)

    def remembered(self, stretch: Stretch) -> Mapping[str, float]:
        """State of its own where a stretch begins, by name; see :meth:`Remembering.remembered`."""
        if not isinstance(self.effect, Remembering):
            return {}
        return self.effect.remembered(self.at, self.theta, stretch)

    def drive(self, inputs: Inputs, scene: Scene) -> None:
        """Change the commands or external forces of a replay, in place."""
        if isinstance(self.effect, OnInputs):
            self.effect.drive(inputs, scene, self.at, self.theta)

    def sense(self, outputs: Outputs, scene: Scene) -> None:
        """Change what a replay's sensors report, in place."""
        if isinstance(self.effect, OnOutputs):
            self.effect.sense(outputs, scene, self.at, self.theta)


Hypothesis = tuple[Planted, ...]
"""Effects that act together."""


def in_order(hypothesis: Sequence[Planted]) -> list[Planted]:
    """Effects in the order in which a command passes them: goals, what is made of these, forces."""
    kinds = OnGoals, OnInputs

    def passed(planted: Planted) -> int:
        found = (i for i, kind in enumerate(kinds) if isinstance(planted.effect, kind))
        return next(found, len(kinds))

    return sorted(hypothesis, key=passed)


def without(hypothesis: Hypothesis, index: int) -> Hypothesis:
    """All effects but one."""
    return hypothesis[:index] + hypothesis[index + 1 :]
