"""The contract of a world, its registry, and the recipe for adding one.

Adding a world is one new file in this package (and its test): define a dataclass of options and
a class with the methods of :class:`World` and the attribute ``options``, decorate the class with
``@register("name")``, and write ``conf/name.yaml`` with ``world.name: name``. The file is found
by itself, in a package of its own too (``wt.worlds.walking``); a name used twice is refused.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float, Float32

import wt.worlds
from wt.config import parse
from wt.data.history import remember, with_history
from wt.errors import ConfigError, suggest
from wt.types import Domain, Pairs, Transitions, TransitionSpec

Progress = Callable[[int, int], None]
"""Called with (done, total) transitions while a world collects."""

NOTHING_HIDDEN = (
    "Nothing is hidden on purpose in this task: every method starts from the same observation and "
    "the same command, and the simulator is reset to the measured state."
)
"""The note of a world without a hidden variable."""


@runtime_checkable
class World(Protocol):
    """Two domains of one robot task, S (simulation) and R (reality).

    Attributes:
        options: dataclass of the ``world:`` section; the constructor takes an instance.
        spec: layout of the task's transitions.
        shard: number of transitions in one file of a collection.
        force_body: body that a hidden force acts on, if that is what h is (first three channels,
            world frame); it is drawn as an arrow.
        note: assumption behind a table of errors, in words; None for the paper's assumption, that S
            is given R's hidden variable.
    """

    options: ClassVar[type]
    spec: TransitionSpec
    shard: int
    force_body: str | None
    note: str | None

    def __init__(self, options: Any) -> None:  # noqa: ANN401 – each world has its own
        """Build both domains."""

    def identity(self) -> dict[str, object]:
        """Plain content that decides what is collected; its hash decides about reuse."""
        ...

    def model(self, domain: Domain) -> mujoco.MjModel:
        """The compiled MJCF of a domain (for R of a real robot: S's, for drawing only)."""
        ...

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """At least ``count`` transitions of one domain in closed loop, cut to ``count``.

        The same seed gives the same transitions; different seeds give unpaired ones.
        """
        ...

    def sim_step(
        self,
        o: Float[np.ndarray, "sample obs"],
        a: Float[np.ndarray, "sample action"],
        hidden: Float[np.ndarray, "sample hidden"] | None,
    ) -> Float32[np.ndarray, "sample state"]:
        """S's answer to (o, a) under a hidden variable.

        Args:
            o: observations that S is reset to.
            a: actions.
            hidden: hidden variable during the step; None for nothing hidden.

        Returns:
            S's state channels one control step later.
        """
        ...

    def answers(self, real: Transitions) -> Float32[np.ndarray, "transition state"]:
        """S's state channels after each of R's transitions, under what was hidden then.

        What pairs are made of. Nobody has them of a real robot with something hidden, so nothing
        but the paired ceiling is trained on them.
        """
        ...

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """Paired transitions for a split, ``"validation"`` or ``"test"``, never trained on."""
        ...


_WORLDS: dict[str, type[Any]] = {}

W = TypeVar("W", bound=type)  # a class; that it is a World shows when it is made


def register(name: str) -> Callable[[W], W]:
    """Class decorator: make a world available under ``name``.

    The class takes one argument, an instance of the dataclass in its attribute ``options``,
    which is the schema of the configuration's ``world:`` section.

    Raises:
        ConfigError: two files claim the same name.
    """

    def add(world: W) -> W:
        if name in _WORLDS:
            raise ConfigError(
                f"world {name!r} is defined by both {_WORLDS[name].__module__} "
                f"and {world.__module__}; rename one"
            )
        _WORLDS[name] = world
        return world

    return add


def kind_of(section: Mapping[str, Any]) -> type[Any]:
    """The class of the world that a configuration's ``world:`` section names.

    Args:
        section: ``name``, and the options of that world.

    Raises:
        ConfigError: no world has that name.
    """
    for module in pkgutil.walk_packages(wt.worlds.__path__, "wt.worlds."):
        importlib.import_module(module.name)
    name = str(section.get("name", ""))
    if name not in _WORLDS:
        raise ConfigError(f"world.name {name!r} is not known: {suggest(name, _WORLDS)}")
    return _WORLDS[name]


def make(section: Mapping[str, Any]) -> World:
    """Build the world of a configuration's ``world:`` section.

    Args:
        section: ``name`` and the options of that world; ``history``, of any world, is the number of
            control steps whose positions and actions its observations also hold.

    Raises:
        ConfigError: no world has that name, or an option is unknown or of the wrong type.
    """
    kind = kind_of(section)
    options = {key: value for key, value in section.items() if key != "name"}
    own = "history" in {field.name for field in fields(kind.options)}
    history = 0 if own else options.pop("history", 0)
    if not isinstance(history, int) or history < 0:
        raise ConfigError(f"world.history is {history!r}; it must be a whole number, zero or more")
    world: World = kind(parse(kind.options, options, "world."))
    return Remembering(world, history) if history else world


class Remembering:
    """A world whose observations also hold the positions and actions of some steps before.

    For a robot that carries what S knows nothing of: the past may tell what no simulated outcome
    can. It cannot be rolled out, since nobody keeps the past of a simulated robot.
    """

    options: ClassVar[type] = object  # it is made of another world, not of options

    def __init__(self, world: World, history: int) -> None:
        """Extend a world.

        Args:
            world: without history.
            history: control steps that are remembered.
        """
        self._world, self._history = world, history
        self.spec = with_history(world.spec, history)
        self.shard, self.force_body, self.note = world.shard, world.force_body, world.note

    def identity(self) -> dict[str, object]:
        """Of the world, and the length of its history."""
        return {**self._world.identity(), "history": self._history}

    def model(self, domain: Domain) -> mujoco.MjModel:
        """The compiled MJCF of a domain."""
        return self._world.model(domain)

    def collect(
        self, domain: Domain, count: int, seed: int, progress: Progress | None = None
    ) -> Transitions:
        """Transitions that have a past: fewer than ``count``, by the beginnings of episodes."""
        collected = self._world.collect(domain, count, seed, progress)
        return remember(collected, self._world.spec, self._history)[0]

    def sim_step(
        self,
        o: Float[np.ndarray, "sample obs"],
        a: Float[np.ndarray, "sample action"],
        hidden: Float[np.ndarray, "sample hidden"] | None,
    ) -> Float32[np.ndarray, "sample state"]:
        """S's answer, which does not depend on the past."""
        return self._world.sim_step(o[:, : self._world.spec.n_obs], a, hidden)

    def answers(self, real: Transitions) -> Float32[np.ndarray, "transition state"]:
        """S's answers to R's transitions."""
        return self._world.answers(replace(real, o=real.o[:, : self._world.spec.n_obs]))

    def pairs(self, split: str, count: int, seed: int) -> Pairs:
        """Paired transitions that have a past."""
        pairs = self._world.pairs(split, count, seed)
        real, rows = remember(pairs.real, self._world.spec, self._history)
        return Pairs(real, pairs.sim_next[rows])
