"""The contract of an audit, its registry, and how to add one.

An audit is one new file in :mod:`wt.check.audits` and its test: a class with the members of
:class:`Audit`, or of :class:`ChannelAudit`, decorated with ``@register``. The file is found by
itself.

An :class:`Audit` looks at a recording, a model or both, and says what it sees. It must stay silent
where it lacks what it looks at, and where missing physics may look the same. Its stage says when
it runs: what one stage finds is mended before the next one looks.

A :class:`ChannelAudit` only suspects: it lists mix-ups of columns that would be of its kind, and
:mod:`wt.check.channels` keeps those without which the model cannot explain the commands.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, Protocol, TypeVar, get_args, runtime_checkable

from wt.check.balance import Balance, Edit
from wt.check.finding import AuditFinding
from wt.check.signals import Signals
from wt.physics.scene import Scene
from wt.types import Recording

Stage = Literal["clock", "pace", "column", "gain", "channel", "joint", "range", "velocity", "rest"]
"""Order of the audits: time; its pace; columns by themselves; gains of all drives; which is which;
whole joints; where they begin and end; velocities; everything else."""
STAGES: tuple[Stage, ...] = get_args(Stage)


@dataclass(frozen=True, eq=False)
class Subject:
    """What is audited: a model, a recording, or a recording of the model's machine.

    Attributes:
        scene: the model; None if there is none.
        recording: the recording; None if there is none.
        commands_hold: whether its commands are what the drives were sent.
    """

    scene: Scene | None
    recording: Recording | None
    commands_hold: bool = True

    @cached_property
    def signals(self) -> Signals | None:
        """The smooth motion and commands; None where there is nothing to compare."""
        if self.scene is None or self.recording is None:
            return None
        return Signals.of(self.scene, self.recording)

    @cached_property
    def balance(self) -> Balance | None:
        """How much of the commands the model explains; None where there is nothing to compare."""
        if self.scene is None or self.signals is None or not self.commands_hold:
            return None
        return Balance(self.scene, self.signals)


@dataclass(frozen=True, eq=False)
class Suspect:
    """A mix-up of columns that may have happened.

    Attributes:
        kind: of fault.
        edits: what undoes it, in the model's channels.
        evidence: what it would be, e.g. ``"elbow's encoder counts backwards"``.
        fix: entry of a map that undoes it; "" for that which its edits make.
        elements: of the model, where these may be at fault instead.
    """

    kind: str
    edits: tuple[Edit, ...]
    evidence: str
    fix: str
    elements: tuple[str, ...] = ()


@runtime_checkable
class Audit(Protocol):
    """An audit that sees a fault by itself.

    Attributes:
        kinds: of the findings it makes.
        stage: when it runs.
    """

    kinds: ClassVar[tuple[str, ...]]
    stage: ClassVar[Stage]

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """What it sees; nothing is the usual answer."""
        ...


@runtime_checkable
class ChannelAudit(Protocol):
    """An audit that suspects mix-ups of columns.

    Attributes:
        kinds: of the suspects it lists.
    """

    kinds: ClassVar[tuple[str, ...]]

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """The mix-ups to be tried."""
        ...


T = TypeVar("T", bound=type)
_AUDITS: dict[str, Audit | ChannelAudit] = {}


def register(audit: T) -> T:
    """Class decorator: make an audit available."""
    _AUDITS[f"{audit.__module__}.{audit.__name__}"] = audit()
    return audit


def audits() -> tuple[Audit | ChannelAudit, ...]:
    """Every audit, in the order of their files' names."""
    import wt.check.audits

    for module in pkgutil.iter_modules(wt.check.audits.__path__):
        importlib.import_module(f"wt.check.audits.{module.name}")
    return tuple(_AUDITS[name] for name in sorted(_AUDITS))
