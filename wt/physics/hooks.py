"""Hooks for effects that take more than a signature and a patch: base classes to be combined.

An effect derives from those that it needs; code that works with any effect asks for them with
``isinstance``, or uses :class:`~wt.physics.planted.Planted`, which knows the answer where an
effect does not have a hook.

============== ==================================================================================
FromRecordings part of it is read off the recordings instead of fitted: times of events, a load
Evident        recordings show it at moments of their own, whatever else a model leaves out
Linearised     its force is linear in its first parameter and in that one's products with others
Nested         it contains a law with fewer parameters
Uniting        it says alone what several others do together
Stateful       its patch adds joints, which have a state when a replay begins
Remembering    it has a state that comes of all that was before a replay begins
OnInputs       a replay's commands or external forces are changed
OnOutputs      what a replay's sensors report is changed
OnSteps        it acts at every physics step of a replay
Tolerated      a little of it is an error that any model makes
============== ==================================================================================
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.physics.effect import Effect, Shape
from wt.physics.live import Live
from wt.physics.motion import Motion
from wt.physics.replay import Hidden, Inputs, Outputs, Stretch
from wt.physics.scene import Scene
from wt.types import Location

Beyond = tuple[Shape, Float[np.ndarray, " parameter"]]  # a shape, and parameters under it
Shown = tuple[Effect, Float[np.ndarray, " _"]]  # as some recordings show it
# name of a parameter → lower and upper end of what it may be
Intervals = Mapping[str, tuple[float | tuple[float, ...], float | tuple[float, ...]]]


class FromRecordings(Effect):
    """An effect of which a part is read off the recordings instead of fitted.

    Attributes:
        reads_residual: whether the shapes to try are read off the force residual.
        read_off: how many of a shape's last values come from the recordings and are not fitted.
        momentary: whether it acts at moments that are read off: no other recording predicts them.
    """

    reads_residual: ClassVar[bool] = False
    momentary: ClassVar[bool] = False
    read_off: ClassVar[int] = 0

    def shaped(self, shape: Shape) -> Effect:
        """The effect bound to what ``theta`` leaves open of a shape, such as times of events."""
        return self

    def elsewhere(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> Shown:
        """The effect as it shows in other recordings; events have times of their own there."""
        return self, theta

    def beside(self, theta: Float[np.ndarray, " parameter"], elsewhere: Shown) -> Shown:
        """The effect with what other recordings show of it, too; events have all their times."""
        return self, theta

    def observed(self) -> Mapping[str, tuple[str, tuple[float, ...]]]:
        """Figures that were read off, by name: (unit, values)."""
        return {}

    @property
    def n_free(self) -> int:
        """Number of figures that were chosen for it: ``theta``, and what was read off."""
        return self.n_theta + sum(len(values) for _, values in self.observed().values())


class Evident(FromRecordings):
    """An effect of events that stand out by themselves, whatever else a model leaves out.

    It has one parameter, with a component for each event.
    """

    DEVIATIONS: ClassVar[float] = 5.0
    """Robust deviations of what models are usually off by, from which an event stands out."""

    @abc.abstractmethod
    def evident(
        self, motion: Motion, at: Location
    ) -> tuple[Effect, Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]] | None:
        """All that stands out of some recordings, for these only.

        Returns:
            (the effect, its parameters, half widths of their 95 % intervals); None if nothing does.
        """

    @abc.abstractmethod
    def only(
        self, theta: Float[np.ndarray, " parameter"], kept: Bool[np.ndarray, " parameter"]
    ) -> Shown:
        """The effect with some of its events."""


def shaped(effect: Effect, shape: Shape) -> Effect:
    """An effect bound to a shape; itself, if nothing of it is read off the recordings."""
    return effect.shaped(shape) if isinstance(effect, FromRecordings) else effect


def observed(effect: Effect) -> Mapping[str, tuple[str, tuple[float, ...]]]:
    """Figures of an effect that were read off the recordings, by name: (unit, values)."""
    return effect.observed() if isinstance(effect, FromRecordings) else {}


def n_fitted(effect: Effect, shape: Shape) -> int:
    """Number of a shape's values that are fitted; those behind them are read off."""
    read_off = effect.read_off if isinstance(effect, FromRecordings) else 0
    return max(len(shape) - read_off, 0)


class Linearised(Effect):
    """An effect whose force is linear in its first parameter and its products with the others.

    So these are what moves in a step: from a weak spring to a stiff one the point that it pulls to
    goes as far as the pull says, not as its own slope would have it.
    """

    def around(self, theta: Float[np.ndarray, " parameter"]) -> Shape | None:
        """The shape whose first column is all of the force at ``theta``; None if there is none."""
        return None

    def reach(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
        """Smallest and largest step to ask :meth:`moved` for."""
        lower, upper = (bound - theta for bound in self.bounds())
        lower[1:], upper[1:] = -np.inf, np.inf
        return lower, upper

    def moved(
        self, theta: Float[np.ndarray, " parameter"], step: Float[np.ndarray, " parameter"]
    ) -> Float[np.ndarray, " parameter"]:
        """``theta`` after a step that takes the force to be linear, inside the bounds."""
        there = theta + step
        if there[0] > 0.0:
            there[1:] = theta[1:] + theta[0] * step[1:] / there[0]
        return np.asarray(np.clip(there, *self.bounds()))


def around(effect: Effect, theta: Float[np.ndarray, " parameter"]) -> Shape | None:
    """The shape whose first column is all of an effect's force; None if there is none."""
    return effect.around(theta) if isinstance(effect, Linearised) else None


class Nested(Effect):
    """An effect that contains a law with fewer parameters."""

    def beyond(
        self, motion: Motion, at: Location, law: str, theta: Float[np.ndarray, " smaller"]
    ) -> Sequence[Beyond]:
        """Starting points where another law, of that id and with that ``theta``, was found."""
        return []

    def simpler(
        self,
        motion: Motion,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        intervals: Intervals,
    ) -> tuple[str, Float[np.ndarray, " smaller"]] | None:
        """The law with fewer parameters that this one is no different from, as far as is known.

        Args:
            motion: the recordings.
            at: where it stands.
            theta: its parameters.
            intervals: name of a parameter → lower and upper end of its 95 % interval.

        Returns:
            Id and parameters of that law; None if this one is needed.
        """
        return None


Parts = Mapping[tuple[str, Location], Float[np.ndarray, " _"]]
"""Effects that stand somewhere: (id, place) → parameters."""


class Uniting(Effect):
    """An effect that may say alone what several others at its place, or near it, do together.

    Attributes:
        unites: their ids.
    """

    unites: ClassVar[tuple[str, ...]] = ()

    def near(self, scene: Scene, at: Location) -> tuple[Location, ...]:
        """Other places whose effects it may say, too."""
        return ()

    @abc.abstractmethod
    def union(
        self, motion: Motion, at: Location, parts: Parts
    ) -> Float[np.ndarray, " parameter"] | None:
        """Its parameters in the place of several effects; None if it cannot be all that.

        Args:
            motion: the recordings.
            at: where it is to stand.
            parts: two or more of these effects.
        """


class Stateful(Effect):
    """An effect whose patch adds joints, which have a state when a replay begins."""

    def followers(self, at: Location) -> Mapping[str, str]:
        """Joints that the patch adds → the user's joint from whose state each one starts."""
        return {}

    def balanced(
        self,
        at: Location,
        theta: Float[np.ndarray, " parameter"],
        scene: Scene,
        joints: Mapping[str, tuple[float, float]],
        command: Float[np.ndarray, " actuator"],
    ) -> Mapping[str, tuple[float, float]]:
        """Positions and velocities of the added joints beside those of a machine at rest.

        Args:
            at: where it stands.
            theta: its parameters.
            scene: the machine as given.
            joints: position and velocity of the machine's hinges and slides.
            command: of its actuators.
        """
        return {name: joints[leader] for name, leader in self.followers(at).items()}

    @abc.abstractmethod
    def started(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, Hidden]:
        """States that joints of the patch have where a stretch begins."""


class Remembering(Effect):
    """An effect with a state of its own that comes of all that was before a replay begins."""

    @abc.abstractmethod
    def remembered(
        self, at: Location, theta: Float[np.ndarray, " parameter"], stretch: Stretch
    ) -> Mapping[str, float]:
        """Its state where a stretch begins, by the names that written files know it by.

        ``<actuator> goal`` and ``<actuator> integral`` are activations of a ``pid`` actuator,
        ``<tendon> bend`` is how far the spring of one that yields is bent; what else there is are
        hidden states of ``physics.py``.
        """


class Limiting(Effect):
    """An effect by which a drive gives no more than some force: laws see it as it is with that."""

    @abc.abstractmethod
    def most(self, theta: Float[np.ndarray, " parameter"]) -> float:
        """Largest force on the joint [N·m or N]."""


class InReplay(Effect):
    """An effect that a replay brings about by itself, without the patch: the user's stand-in."""

    def cleared(self, spec: mujoco.MjSpec, at: Location) -> None:
        """Take out of a replay's MJCF, in place, what the effect acts instead of."""


class OnInputs(InReplay):
    """An effect on what drives a replay."""

    @abc.abstractmethod
    def drive(
        self, inputs: Inputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Change the commands or external forces of a replay, in place."""


class OnGoals(OnInputs):
    """An effect on where a drive's goal is: what else is made of commands is made of that."""


class OnOutputs(InReplay):
    """An effect on what is measured."""

    @abc.abstractmethod
    def sense(
        self, outputs: Outputs, scene: Scene, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Change what a replay's sensors report, in place."""


class OnSteps(InReplay):
    """An effect that acts at every physics step."""

    @abc.abstractmethod
    def live(
        self,
        scene: Scene,
        at: Sequence[Location],
        theta: Float[np.ndarray, "place parameter"],
        h: float,
    ) -> Live:
        """The law that acts at some places of some replays, each with its own ``theta``.

        Args:
            scene: the machine.
            at: places.
            theta: parameters at each.
            h: physics step [s].
        """


@dataclass(frozen=True)
class Tolerance:
    """Error that any model makes.

    Attributes:
        size: one standard deviation of the parameter from neutral, in its unit.
        lowest: smallest parameter that a model can hold.
    """

    size: float
    lowest: float = -np.inf


class Tolerated(Effect):
    """An effect, of one parameter, of which any model is off by a little.

    Attributes:
        correctable: whether a model can be corrected by it; nothing can come early, say.
        at_rest: whether it acts on a machine that stands still.
    """

    correctable: ClassVar[bool] = True
    at_rest: ClassVar[bool] = False

    @abc.abstractmethod
    def tolerances(self, scene: Scene) -> Mapping[Location, Tolerance]:
        """Sizes of the error at the places of a machine that have it."""

    def small(self, motion: Motion, at: Location, size: float) -> Float[np.ndarray, "sample dof"]:
        """Generalised force of an error of that size from neutral [N·m]."""
        return size * self.columns(motion, at, ())[:, :, 0]
