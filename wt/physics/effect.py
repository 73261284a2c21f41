"""The contract of an effect, its registry, and how to add one.

An effect is physics that a simulator may leave out: a friction law, a delay, a payload. To find
it in recordings, ``wt diagnose`` needs three things of it:

1. a quick *signature*: which generalised force it adds along a recorded motion. It is linear in
   some coefficients once a few nonlinear *shape* parameters are given, so that thousands of
   hypotheses are compared in seconds (:meth:`Effect.shapes`, :meth:`Effect.columns`,
   :meth:`Effect.theta`);
2. a *patch* of the MJCF, which is what is written for the user and, by default, what is
   simulated and decided upon (:meth:`Effect.patch`);
3. a *statement* for people.

Adding an effect
----------------
1. One new file in ``wt/physics/effects/``: a subclass of :class:`Effect` decorated with
   ``@register``. The file is found by itself; an id used twice is refused, naming both.
2. Its class says all that others need to know of it: ``looks_like`` which effects it is easily
   taken for, ``common`` how often machines have it, ``plotted_over`` what its force depends on.
   No list of ids anywhere else has to be touched.
3. What a recording can show that rules it out (a stop that is passed) it says itself
   (:meth:`Effect.contradiction`), with an example in ``tests/physics/contradictions.py``.
4. What the contract above cannot say is said by base classes of :mod:`wt.physics.hooks`, as many
   as it needs: what MuJoCo has no element for acts in the replay instead, on its inputs
   (``OnInputs``), its outputs (``OnOutputs``) or at every step (``OnSteps``, by a function that
   is compiled: :mod:`wt.physics.live`); joints that a patch adds have a state (``Stateful``), or
   firmware has one that comes of all that was before (``Remembering``); part of it may be read off
   the recordings (``FromRecordings``); its force may be linear in products only (``Linearised``);
   it may contain a smaller law (``Nested``), or be, where it is small, an error of any model
   (``Tolerated``).
5. One row of truth in ``tests/physics/truths.py``: a machine that has it, by MJCF written by hand
   or a law in closed form, never by the effect's own code.

The contract tests in ``tests/physics/test_contract.py`` then run over it, and fail without the
row; those in ``tests/physics/test_truth.py`` fail if it is another law than the row's.

Conventions: SI units, radians; generalised forces in N·m (N for slides). Parameters state the unit
that they have on a hinge, and sentences are given those of their place (:mod:`wt.physics.units`).
Parameters are one flat vector ``theta`` in the order of :attr:`Effect.parameters`. In annotations
``sample`` are the T samples of a motion, ``dof`` the nv degrees of freedom of its machine,
``coefficient`` those of a signature and ``parameter`` the components of ``theta``.
"""

from __future__ import annotations

import abc
import functools
import importlib
import pkgutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

import mujoco
import numpy as np
from jaxtyping import Float

from wt.physics.motion import Motion
from wt.physics.scene import Scene
from wt.physics.script import Script
from wt.physics.units import HINGE, Units
from wt.types import Kind, Location

Shape = tuple[float, ...]  # the nonlinear parameters that a signature needs to be linear
Common = Literal["seldom", "often", "always"]
"""Grades of how many machines have an effect: ``"often"`` is what may be mounted on one,
``"always"`` what hardly a machine is without."""
Variable = Literal["position", "velocity", "acceleration", "drive", "time"]
"""Variables that a force may be drawn over; ``"drive"`` is the force of the joint's drive."""

LEAST = 1e-12
"""Lower end of what must be more than nothing: smaller than any machine shows, in any unit."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, scalar or a vector.

    Attributes:
        name: as in the table of effects.
        unit: on a hinge, e.g. ``"N·m"``; ``"-"`` for none. On a slide see :meth:`unit_in`.
        lower, upper: smallest and largest admissible value, of every component.
        step: smallest change that matters, the unit of finite differences; 0 for a choice, such as
            a side, which is not fitted.
        axes: names of a vector's components, e.g. ``("x", "y", "z")``; empty for a scalar.
        neutral: of every component, where the effect is nothing; None if it takes more than that.
        public: whether it is one of the table of effects, and reported; else it is only fitted.
        inexact: share of its size by which machines differ from the law at least; None: as usual.
        prior_std: spread of a prior on each step, for where data hardly tell it, see ``refine``.
        of_joint: whether its unit follows the joint; not so where an angle is no joint's.
        all_there_is: whether its ends are natural ones: there is no more to be had, or taken away.
        comes_round: whether it is an angle of which values a turn apart are the same.
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
    prior_std: float = np.inf
    of_joint: bool = True
    all_there_is: bool = False
    comes_round: bool = False

    def unit_in(self, units: Units) -> str:
        """Its unit among those of a place."""
        return units.of(self.unit) if self.of_joint else self.unit

    @property
    def size(self) -> int:
        """Number of its components in ``theta``."""
        return max(1, len(self.axes))


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
        signed: for each coefficient of the signature the sign it must have: +1, -1 or 0 for any.
        settles: ids of small errors of the same place that are nothing beside it.
        looks_like: names of groups; it is easily taken for any other of a group, see
            :func:`alternatives`.
        common: how often real machines have it although their models do not.
        plotted_over: the variable that its force is best seen over.
        each_way: whether that force is another one on the way back.
        stiff: whether it moves faster than the machine, or takes damping away that long steps
            rely on, so that replays take the shortest ones.
        comes_again: whether its force is periodic in the joint's position.
        form: in words, of a law that MuJoCo has in several; "" for the usual one.
        forms: the others.
    """

    id: ClassVar[str]
    kind: ClassVar[Kind]
    parameters: ClassVar[tuple[Parameter, ...]]
    reference: ClassVar[str]
    native: ClassVar[bool] = True
    excludes: ClassVar[tuple[str, ...]] = ()
    odds_against: ClassVar[float] = 0.0
    signed: ClassVar[tuple[int, ...]] = ()
    settles: ClassVar[tuple[str, ...]] = ()
    looks_like: ClassVar[tuple[str, ...]] = ()
    common: ClassVar[Common] = "seldom"
    plotted_over: ClassVar[Variable] = "position"
    each_way: ClassVar[bool] = False
    stiff: ClassVar[bool] = False
    comes_again: ClassVar[bool] = False
    form: ClassVar[str] = ""
    forms: ClassVar[tuple[Effect, ...]] = ()

    def places(self, scene: Scene) -> Sequence[Location]:
        """Places of a model at which it can stand; by default all of its kind."""
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
    def columns(
        self, motion: Motion, at: Location, shape: Shape
    ) -> Float[np.ndarray, "sample dof coefficient"]:
        """Generalised force per unit of each linear coefficient [N·m per its unit].

        It is the force that the effect *adds to the machine*.
        """

    @abc.abstractmethod
    def theta(
        self, coefficients: Float[np.ndarray, " coefficient"], shape: Shape
    ) -> Float[np.ndarray, " parameter"]:
        """Parameters for given coefficients and shape; not yet clipped to their bounds."""

    def starts(self, motion: Motion, at: Location) -> Sequence[Float[np.ndarray, " parameter"]]:
        """Parameters to start the replay's refinement from where no signature tells."""
        return []

    # -- deciding ----------------------------------------------------------------------------

    def patch(  # noqa: B027 – optional
        self, spec: mujoco.MjSpec, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> None:
        """Write the effect into an MJCF, in place; names of the user's elements stay."""

    def script(self, at: Location, theta: Float[np.ndarray, " parameter"]) -> Script | None:
        """Lines of ``physics.py`` for what the patch cannot say; None if it says it all."""
        return None

    def plausible(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> bool:
        """Tell whether such parameters are this effect, and not another one in disguise."""
        return True

    def contradiction(
        self, motion: Motion, at: Location, theta: Float[np.ndarray, " parameter"]
    ) -> str | None:
        """What of a recording makes such parameters impossible, in one clause; None if nothing.

        However well an effect fits: a joint does not pass its own stop.
        """
        return None

    @abc.abstractmethod
    def statement(
        self, at: Location, theta: Float[np.ndarray, " parameter"], units: Units = HINGE
    ) -> str:
        """One plain sentence with figures and units, e.g. "Joint j2 has 1.2° of gear play.".

        Args:
            at: where.
            theta: its parameters.
            units: those at that place, which the sentence states.
        """

    def separation(self, at: Location, units: Units = HINGE) -> str:
        """The experiment that tells this effect best from others at the same place."""
        return f"a multisine on {at} with slow reversals and fast parts"

    def same_as(self, scene: Scene, at: Location) -> Sequence[tuple[str, Location]]:
        """Effects, by id and place, that no recording of this machine can tell from it.

        Not those that some recordings cannot: these are found by replays.
        """
        return ()

    # -- parameters --------------------------------------------------------------------------

    @property
    def n_theta(self) -> int:
        """Length of ``theta``."""
        return sum(p.size for p in self.parameters)

    @property
    def n_free(self) -> int:
        """Number of figures that were chosen for it."""
        return self.n_theta

    def bounds(self) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
        """Smallest and largest admissible ``theta``."""
        ends = ((p.lower, p.upper, p.size) for p in self.parameters)
        lower, upper, sizes = zip(*ends, strict=True)
        return np.repeat(lower, sizes), np.repeat(upper, sizes)

    def steps(self) -> Float[np.ndarray, " parameter"]:
        """Finite-difference steps of ``theta``."""
        return np.repeat([p.step for p in self.parameters], [p.size for p in self.parameters])

    def rows(self) -> Iterator[tuple[Parameter, slice]]:
        """Each parameter, and where it stands in ``theta``."""
        start = 0
        for p in self.parameters:
            yield p, slice(start, start := start + p.size)

    def named(self, theta: Float[np.ndarray, " parameter"]) -> dict[str, float | list[float]]:
        """``theta`` by parameter names: floats, and lists for vectors."""
        return {
            p.name: theta[rows].tolist() if p.axes else float(theta[rows][0])
            for p, rows in self.rows()
        }


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
    ordered = dict(sorted(_EFFECTS.items()))
    _EFFECTS.clear()
    _EFFECTS.update(ordered)
    return effect


def effects() -> Mapping[str, Effect]:
    """Every effect by id, in alphabetical order."""
    _imported()
    return MappingProxyType(_EFFECTS)


def forms_of(effect: Effect) -> tuple[Effect, ...]:
    """All forms of a law, the usual one first; most have one only, itself."""
    usual = effects().get(effect.id, effect)
    family = (usual, *usual.forms)
    return family if effect in family else (effect,)  # what is bound to recordings has one


@functools.cache
def _imported() -> None:
    """Import every file of effects, so that each is registered."""
    import wt.physics.effects

    for module in pkgutil.iter_modules(wt.physics.effects.__path__):
        importlib.import_module(f"wt.physics.effects.{module.name}")


def alternatives(effect: str) -> frozenset[str]:
    """Ids of the effects that one is easily taken for; it is one of theirs, too.

    Args:
        effect: id of an effect; one that is not registered, such as a learned law, has none.
    """
    known = effects()
    mine = set(known[effect].looks_like) if effect in known else set()
    others = (e.id for e in known.values() if mine.intersection(e.looks_like))
    return frozenset(others) - {effect}
