"""The contract of an effect, its registry, and how to add one.

An effect is physics that a simulator may leave out: a friction law, a delay, a payload. To find
it in recordings, ``wt diagnose`` needs three things of it:

1. a quick *signature*: which generalised force it adds along a recorded motion. It is linear in
   some coefficients once a few nonlinear *shape* parameters are given, so that thousands of
   hypotheses are compared in seconds (:meth:`Effect.shapes`, :meth:`Effect.columns`,
   :meth:`Effect.theta`);
2. a *patch* of the MJCF, which is what is written for the user and, by default, what is
   simulated and decided upon (:meth:`Effect.patch`). What MuJoCo has no element for is done to
   the replay's inputs (:meth:`Effect.drive`), outputs (:meth:`Effect.sense`) or at every step
   (:meth:`Effect.live`); then :meth:`Effect.model` says what the replayed MJCF needs instead;
3. a *statement* for people.

Adding an effect
----------------
One new file in ``wt/physics/effects/`` and one row in the table of effects: a subclass of
:class:`Effect` decorated with ``@register``. The file is found by itself; an id used twice is
refused, naming both. The contract tests in ``tests/physics/test_contract.py`` then run over it.

Conventions: SI units, radians; generalised forces in N·m (N for slides); parameters are one flat
vector ``theta`` in the order of :attr:`Effect.parameters`.
"""

from __future__ import annotations

import abc
import importlib
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import mujoco
import numpy as np

from wt.physics.script import Script
from wt.types import Kind, Location

if TYPE_CHECKING:
    from wt.physics.live import Live
    from wt.physics.motion import Motion
    from wt.physics.replay import Hidden, Inputs, Outputs, Stretch
    from wt.physics.scene import Scene

Array = np.ndarray
Shape = tuple[float, ...]  # the nonlinear parameters that a signature needs to be linear
Beyond = tuple[Shape, Array]  # a shape, and parameters under it


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, scalar or a vector.

    Attributes:
        name: as in the table of effects.
        unit: e.g. ``"N·m"``; ``"-"`` for none.
        lower, upper: smallest and largest admissible value, of every component.
        step: smallest change that matters, the unit of finite differences.
        axes: names of a vector's components, e.g. ``("x", "y", "z")``; empty for a scalar.
        neutral: of every component, where the effect is nothing; None if it takes more than that.
        public: whether it is one of the table of effects, and reported; else it is only fitted.
        inexact: share of its size by which machines differ from the law at least; None: as usual.
        hold: how far a step goes where data hardly tell it, see ``refine``; infinite for any.
    """

    name: str
    unit: str
    lower: float
    upper: float
    step: float
    axes: tuple[str, ...] = ()
    neutral: float | None = None
    public: bool = True
    inexact: float | None = None
    hold: float = np.inf

    @property
    def size(self) -> int:
        """How many components it has in ``theta``."""
        return max(1, len(self.axes))


# lower and upper end of what each parameter may be
Intervals = Mapping[str, tuple[float | tuple[float, ...], float | tuple[float, ...]]]


class Effect(abc.ABC):
    """Physics that a model may leave out; the module says how to add one.

    Attributes:
        id: as in the table of effects, e.g. ``"joint.friction_coulomb"``.
        kind: what it stands at.
        parameters: what is to be estimated, in the order of ``theta``.
        reference: where the law comes from.
        native: whether the patch expresses it fully in MJCF.
        excludes: ids that cannot stand at the same place beside it.
        odds_against: log odds against it beside a more common effect that fits as well [nats].
        reads_residual: whether the shapes to try are read off the force residual.
        signed: for each coefficient of the signature the sign it must have: +1, -1 or 0 for any.
        read_off: how many of a shape's last values come from the recordings and are not fitted.
        weighted: whether the force is linear in the first parameter and its products with others.
        settles: ids of small errors of the same place that are nothing beside it.
    """

    id: ClassVar[str]
    kind: ClassVar[Kind]
    parameters: ClassVar[tuple[Parameter, ...]]
    reference: ClassVar[str]
    native: ClassVar[bool] = True
    excludes: ClassVar[tuple[str, ...]] = ()
    odds_against: ClassVar[float] = 0.0
    reads_residual: ClassVar[bool] = False
    signed: ClassVar[tuple[int, ...]] = ()
    read_off: ClassVar[int] = 0
    weighted: ClassVar[bool] = False
    settles: ClassVar[tuple[str, ...]] = ()

    def places(self, scene: Scene) -> Sequence[Location]:
        """Where in a model it can stand; by default everywhere of its kind."""
        drives = [d.name for d in scene.drives]
        names: Mapping[str, Sequence[str]] = {
            "joint": scene.own_joints, "actuator": drives, "body": scene.moving, "world": ["world"]
        }  # fmt: skip
        return [Location(self.kind, name) for name in names.get(self.kind, ())]

    # -- screening ---------------------------------------------------------------------------

    def shapes(self, motion: Motion, at: Location) -> Sequence[Shape]:
        """Shapes to try, coarsely; ``[()]`` if the signature is linear as it is.

        An empty list says that the signature cannot tell (replay only).
        """
        return [()]

    @abc.abstractmethod
    def columns(self, motion: Motion, at: Location, shape: Shape) -> Array:
        """Generalised force per unit of each linear coefficient.

        Returns:
            (n_samples, nv, n_coefficients) [N·m per unit of the coefficient], the force that the
            effect *adds to the machine*.
        """

    @abc.abstractmethod
    def theta(self, coefficients: Array, shape: Shape) -> Array:
        """Parameters for given coefficients and shape, (n_theta,); not yet clipped to bounds."""

    def around(self, theta: Array) -> Shape | None:
        """The shape whose first column is all of the force at ``theta``; None if there is none."""
        return None

    def starts(self, motion: Motion, at: Location) -> Sequence[Array]:
        """Parameters to start the replay's refinement from where no signature tells."""
        return []

    def beyond(self, motion: Motion, at: Location, law: str, theta: Array) -> Sequence[Beyond]:
        """Where to start from if a law that this one contains was found there."""
        return []

    def shaped(self, shape: Shape) -> Effect:
        """The effect bound to what ``theta`` leaves open of a shape, such as times of events."""
        return self

    def elsewhere(self, motion: Motion, at: Location, theta: Array) -> Effect:
        """The effect as it shows in other recordings; events have times of their own there."""
        return self

    # -- replay ------------------------------------------------------------------------------

    def patch(self, spec: mujoco.MjSpec, at: Location, theta: Array) -> None:  # noqa: B027 – optional
        """Write the effect into an MJCF, in place; names of the user's elements stay."""

    def model(self, spec: mujoco.MjSpec, at: Location, theta: Array) -> None:
        """Prepare the MJCF of a replay, in place; by default with the patch."""
        self.patch(spec, at, theta)

    def followers(self, at: Location) -> Mapping[str, str]:
        """Joints that the patch adds → the user's joint from whose state each one starts."""
        return {}

    def started(self, at: Location, theta: Array, stretch: Stretch) -> Mapping[str, Hidden]:
        """States that joints of the patch have where a stretch begins."""
        return {}

    def drive(self, inputs: Inputs, scene: Scene, at: Location, theta: Array) -> None:  # noqa: B027 – optional
        """Change the commands or external forces of a replay, in place."""

    def sense(self, outputs: Outputs, scene: Scene, at: Location, theta: Array) -> None:  # noqa: B027 – optional
        """Change what a replay's sensors report, in place."""

    def live(self, scene: Scene, at: Location, theta: Array) -> Live | None:
        """What acts at every physics step of the replays of ``theta`` (n_replays, n_theta)."""
        return None

    def script(self, at: Location, theta: Array) -> Script | None:
        """Lines of ``physics.py`` for what the patch cannot say; None if it says it all."""
        return None

    def plausible(self, motion: Motion, at: Location, theta: Array) -> bool:
        """Whether such parameters are this effect, and not another one in disguise."""
        return True

    def simpler(
        self, motion: Motion, at: Location, theta: Array, intervals: Intervals
    ) -> tuple[str, Array] | None:
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

    @abc.abstractmethod
    def statement(self, at: Location, theta: Array) -> str:
        """One plain sentence with figures and units, e.g. "Joint j2 has 1.2° of gear play."."""

    def separation(self, at: Location) -> str:
        """The experiment that tells this effect best from others at the same place."""
        return f"a multisine on {at} with slow reversals and fast parts"

    @property
    def n_theta(self) -> int:
        """Length of ``theta``."""
        return sum(p.size for p in self.parameters)

    @property
    def n_free(self) -> int:
        """How many figures were chosen for it: ``theta``, and what was read off."""
        return self.n_theta + sum(len(values) for _, values in self.observed().values())

    def bounds(self) -> tuple[Array, Array]:
        """Smallest and largest admissible ``theta``."""
        ends = ((p.lower, p.upper, p.size) for p in self.parameters)
        lower, upper, sizes = zip(*ends, strict=True)
        return np.repeat(lower, sizes), np.repeat(upper, sizes)

    def steps(self) -> Array:
        """Finite-difference steps of ``theta``."""
        return np.repeat([p.step for p in self.parameters], [p.size for p in self.parameters])

    def reach(self, theta: Array) -> tuple[Array, Array]:
        """Smallest and largest step to ask :meth:`moved` for."""
        lower, upper = (bound - theta for bound in self.bounds())
        if self.weighted:
            lower[1:], upper[1:] = -np.inf, np.inf
        return lower, upper

    def moved(self, theta: Array, step: Array) -> Array:
        """``theta`` after a step that takes the force to be linear, inside the bounds.

        Where it is linear in products, these are what moves: from a weak spring to a stiff one the
        point that it pulls to goes as far as the pull says, not as its own slope would have it.
        """
        there = theta + step
        if self.weighted and there[0] > 0.0:
            there[1:] = theta[1:] + theta[0] * step[1:] / there[0]
        return np.asarray(np.clip(there, *self.bounds()))

    def observed(self) -> Mapping[str, tuple[str, tuple[float, ...]]]:
        """What was read off the recordings instead of fitted: name → (unit, values)."""
        return {}

    def named(self, theta: Array) -> dict[str, float | list[float]]:
        """``theta`` by parameter names: floats, and lists for vectors."""
        values: dict[str, float | list[float]] = {}
        ends = np.cumsum([p.size for p in self.parameters])
        for p, part in zip(self.parameters, np.split(theta, ends[:-1]), strict=True):
            values[p.name] = part.tolist() if p.axes else float(part[0])
        return values


_EFFECTS: dict[str, Effect] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Class decorator: make an effect available.

    Raises:
        ValueError: two files claim the same id (a mistake of ours, not of a user).
    """
    if effect.id in _EFFECTS:
        both = f"{type(_EFFECTS[effect.id]).__module__} and {effect.__module__}"
        raise ValueError(f"effect {effect.id!r} is defined by both {both}; rename one")
    _EFFECTS[effect.id] = effect()
    return effect


def effects() -> Mapping[str, Effect]:
    """Every effect by id, in alphabetical order."""
    import wt.physics.effects

    for module in pkgutil.iter_modules(wt.physics.effects.__path__):
        importlib.import_module(f"wt.physics.effects.{module.name}")
    return dict(sorted(_EFFECTS.items()))
