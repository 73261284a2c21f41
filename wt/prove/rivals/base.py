"""The interface of a rival: its task and its claims."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.recordings.smooth import smooth
from wt.mjcf.edit import patched_xml
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.physics.units import units_at
from wt.types import Location

SURE = 1.96
"""Standard deviations from the middle to the end of a 95 % interval."""


@dataclass(frozen=True)
class RivalTask:
    """The task of a rival.

    Attributes:
        model: the MJCF.
        fit: recordings to learn from.
        holdout: recordings that nothing may be fitted to.
        seconds: time budget; a step begun within it may be finished [s].
        began: start of the task, by the monotonic clock [s].
    """

    model: Path
    fit: tuple[Path, ...]
    holdout: tuple[Path, ...]
    seconds: float
    began: float = field(default_factory=time.monotonic)

    @property
    def left(self) -> float:
        """Seconds that are left; negative when time is up."""
        return self.seconds - (time.monotonic() - self.began)

    @cached_property
    def scene(self) -> Scene:
        """The model."""
        return Scene(self.model)

    @cached_property
    def motion(self) -> Motion:
        """The fitted recordings, smoothed."""
        return smooth(self.scene, prepare(self.scene, self.fit, self.holdout).fit).motion


@dataclass(frozen=True)
class Claim:
    """An effect that a rival says is there.

    Attributes:
        effect: its id.
        at: its place.
        theta: its parameters; empty for ``unknown``.
        sigma: their standard deviations.
        formula: an unknown force, in words.
    """

    effect: str
    at: Location
    theta: Float[np.ndarray, " theta"]
    sigma: Float[np.ndarray, " _sigma"]
    formula: str | None = None

    def to_json(self, scene: Scene) -> dict[str, Any]:
        """As in ``diagnosis.json``, in the units of the place."""
        parameters, units = {}, units_at(scene, self.at)
        start = 0
        for p in effects()[self.effect].parameters if self.theta.size else ():
            part = slice(start, start := start + p.size)
            ends = (self.theta[part] + sign * SURE * self.sigma[part] for sign in (-1.0, 1.0))
            parameters[p.name] = {
                "value": _plain(self.theta[part]),
                "unit": p.unit_in(units),
                "ci95": [_plain(end) for end in ends],
            }
        return {
            "effect": self.effect,
            "at": {"kind": self.at.kind, "name": self.at.name},
            "parameters": parameters,
            "confusable_with": [],
            "formula": self.formula,
        }


def write(task: RivalTask, claims: Sequence[Claim], out: Path) -> None:
    """Write claims, most important first, as ``diagnosis.json`` and ``model.xml``."""
    known = effects()
    hypothesis = [Planted(known[c.effect], c.at, c.theta) for c in claims if c.theta.size]
    out.mkdir(parents=True, exist_ok=True)
    xml = patched_xml(task.scene, tuple(hypothesis), [p.statement(task.scene) for p in hypothesis])
    (out / "model.xml").write_text(xml)
    said = {"schema": 1, "findings": [claim.to_json(task.scene) for claim in claims]}
    (out / "diagnosis.json").write_text(json.dumps(said, indent=2, allow_nan=False) + "\n")


def _plain(values: Float[np.ndarray, " element"]) -> float | list[float]:
    return float(values[0]) if values.size == 1 else [float(v) for v in values]
