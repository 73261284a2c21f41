"""A case of the trials: its hidden effects, and its recordings."""

from __future__ import annotations

from dataclasses import dataclass, field

from wt.prove.case_spec import Decoy, Kind
from wt.prove.hidden import Parameters
from wt.prove.sensing import Sensing


@dataclass(frozen=True)
class HiddenEffect:
    """One hidden effect.

    Attributes:
        effect: id; ``unknown`` for an outsider, whose own name is in ``law``.
        kind: ``at.kind`` of the interface.
        name: ``at.name``.
        parameters: by the names of the interface, SI units.
        law: name of the law that acts.
        accept: other place names that are as right, as (kind, name).
    """

    effect: str
    kind: str
    name: str
    parameters: Parameters
    law: str
    accept: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Case:
    """One trial.

    Attributes:
        name: unique in its set, e.g. ``012-arm6-joint.backlash-clear``.
        rig: name in ``RIGS``.
        seed: of everything that is random in it.
        kind: single, pair, triple, outsider or null.
        truth: the hidden effects; empty for a null.
        sensing: the robot's sensors and clock.
        motions: of the fit recordings, then the held-out one.
        seconds: length of each recording [s].
        step: time step of the nominal model [s].
        gain: factor on servo stiffness, in nominal model and hidden world alike.
        decoy: feature of a null that tempts to a false claim.
        level: obvious, clear, faint or below (the noise); empty for a null.
        excused: claims that are not counted though they are not hidden, as (effect, kind, name).
    """

    name: str
    rig: str
    seed: int
    kind: Kind
    truth: tuple[HiddenEffect, ...]
    sensing: Sensing
    motions: tuple[str, ...]
    seconds: float
    step: float = 0.002
    gain: float = 1.0
    decoy: Decoy = ""
    level: str = ""
    excused: tuple[tuple[str, str, str], ...] = ()
    notes: str = field(default="", compare=False)
