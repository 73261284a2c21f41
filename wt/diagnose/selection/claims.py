"""What is claimed of a machine, and what that leaves of its recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from wt.diagnose.likelihood.bic import erring
from wt.diagnose.likelihood.estimate import Estimated
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.calibration import comments
from wt.diagnose.selection.events import Event
from wt.diagnose.selection.holdout import Gain
from wt.diagnose.unknown.force import Unknown
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene


@dataclass(frozen=True, eq=False)
class Claims:
    """Effects that are claimed, and what is left unknown.

    Attributes:
        accepted: named effects.
        estimated: their parameters.
        gains: what each is worth on held-out data.
        unknown: forces that no known effect explains.
        corrections: of the model's tolerances, beside the findings.
        events: what happened at moments of its own in each recording.
        suspected: forces that are no noise, of which held-out replays prove no law.
        moments: joint → seconds in which its replays err far more than tolerances can.
    """

    accepted: tuple[Accepted, ...]
    estimated: Estimated
    gains: tuple[Gain, ...]
    unknown: tuple[Unknown, ...]
    corrections: Hypothesis = ()
    events: tuple[Event, ...] = ()
    suspected: tuple[Unknown, ...] = ()
    moments: Mapping[str, float] = field(default_factory=dict)

    def assessed(self, objective: Objective) -> Assessed:
        """The named effects, with all events, on the fitted recordings."""
        if not self.events:
            return self.estimated.assessed
        parts = (*self.estimated.hypothesis, *(e.planted for e in self.events))
        return objective.reference(parts)

    def unexplained(self, objective: Objective) -> dict[str, float]:
        """Joints whose replays err by much although nothing was found, with their shares of it.

        Or by little, if what moves them is no noise.
        """
        if self.accepted or self.unknown or self.events:
            return {}
        surely = [*(u.planted.at.name for u in self.suspected), *self.moments]
        return erring(self.estimated.assessed, objective, surely)

    @property
    def patch(self) -> Hypothesis:
        """Effects that are written into the model: named ones and corrections."""
        return (*self.estimated.hypothesis, *self.corrections)

    def comments(self, scene: Scene) -> list[str]:
        """A sentence for each part of :attr:`patch`."""
        named = [p.statement(scene) for p in self.estimated.hypothesis]
        return named + comments(self.corrections)

    @property
    def complete(self) -> Hypothesis:
        """Findings and corrections."""
        return (*self.hypothesis, *self.corrections)

    @property
    def hypothesis(self) -> Hypothesis:
        """All effects that were found, named ones first, then laws, then events."""
        unnamed: list[Unknown | Event] = [*self.unknown, *self.events]
        return (*self.estimated.hypothesis, *(u.planted for u in unnamed))

    @property
    def shares(self) -> list[float]:
        """Held-out share of each effect of :attr:`hypothesis`."""
        others: list[Unknown | Event] = [*self.unknown, *self.events]
        return [g.share for g in self.gains] + [u.gain.share for u in others]
