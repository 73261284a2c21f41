"""Is the machine that runs now the one in the passport? A score for what it just did.

The diagnosed model, with the parameters of the unit's last session, replays what was just recorded,
as it replays that session's own recordings. Their errors, block by block, are the reference: a
machine that is the same errs as much. How often a rank-sum test may say otherwise of the same
machine is chosen (H. B. Mann and D. R. Whitney, 1947); motions that the reference has nothing like
are not judged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import mannwhitneyu

from wt.data.labels import UNLOADED, Labels
from wt.diagnose import again
from wt.diagnose.again import Left
from wt.errors import UserError, suggest
from wt.passport.add import still_there
from wt.passport.folder import Passport
from wt.physics.planted import Hypothesis, Planted
from wt.types import Recording

FALSE_ALARMS = 1e-3
"""Share of judgements of a machine that did not change which say that it did."""
_FURTHER = 0.1
"""A joint may go further than it ever did in the reference by so much of what it did there."""
_LEAST = 20
"""Blocks that a reference has at least: with fewer the test can hardly say anything."""


@dataclass(frozen=True)
class Judgement:
    """What a stretch of time says of the machine.

    Attributes:
        score: by joint, the error as a multiple of the reference's; medians over blocks.
        p_value: that the errors are as large by chance; 1 where nothing is judged.
        changed: joints that err more than they did.
        why_not: why nothing is judged; "" if it is.
    """

    score: Mapping[str, float]
    p_value: float
    changed: tuple[str, ...]
    why_not: str = ""

    def line(self, unit: str) -> str:
        """For an operator."""
        worst = max(self.changed, key=self.score.__getitem__)
        others = len(self.changed) - 1
        beside = f" (and {others} more)" if others else ""
        return (
            f"{unit} is no longer the machine in its passport: joint {worst}{beside} errs "
            f"{self.score[worst]:.3g} times as much as in its last session (p = {self.p_value:.1g})"
        )

    def to_json(self) -> dict[str, Any]:
        """As it is logged."""
        return {**asdict(self), "changed": list(self.changed)}


class Live:
    """Judges recordings of a unit by its passport.

    Attributes:
        labels: the session that is the reference.
    """

    def __init__(self, passport: Passport, model: Path, unit: str, load: str = "") -> None:
        """Replay the reference.

        Args:
            passport: with the unit in it.
            model: the MJCF that it is of.
            unit: name; "" for the only one.
            load: what it carries; "" for nothing, or the only load that it ever carried.

        Raises:
            UserError: as :func:`reference`; or its recordings are too short.
        """
        self.labels, paths = reference(passport, unit, load)
        self._model, self._hypothesis = model, as_in(passport, self.labels)
        self._reference = self._left(*paths)
        if len(self._reference.error) < _LEAST:
            raise UserError(
                f"the recordings of {self.labels} are too short to tell what is usual: "
                f"{len(self._reference.error)} blocks of up to a second, {_LEAST} are needed"
            )

    def judge(self, recording: Recording) -> Judgement:
        """Judge what was just recorded: some ten seconds, so that there are blocks to compare."""
        try:
            now = self._left(recording)
        except UserError as error:
            return Judgement({}, 1.0, (), str(error))
        reference = self._reference
        usual = np.median(reference.error, axis=0)
        score = dict(zip(now.joints, (np.median(now.error, axis=0) / usual).tolist(), strict=True))
        alike = _alike(now, reference)
        if alike.sum() < 3:
            return Judgement(score, 1.0, (), "it moves further than in its last session")
        p = np.array([_larger(x, y) for x, y in zip(now.error[alike].T, reference.error.T,
                                                    strict=True)])  # fmt: skip
        smallest = min(1.0, float(p.min()) * len(p))
        changed = tuple(j for j, x in zip(now.joints, p * len(p), strict=True) if x <= FALSE_ALARMS)
        return Judgement(score, smallest, changed)

    def _left(self, *recordings: Path | Recording) -> Left:
        return again.left(again.recorded(self._model, recordings), self._hypothesis)


def _alike(now: Left, then: Left) -> Bool[np.ndarray, " block"]:
    """Blocks in which no joint is elsewhere, or moves more, than it ever did."""
    low, high = then.low.min(axis=0), then.high.max(axis=0)
    room = _FURTHER * (high - low)
    where = (now.low >= low - room) & (now.high <= high + room)
    how_far = now.high - now.low <= (1.0 + _FURTHER) * (then.high - then.low).max(axis=0)
    return np.asarray((where & how_far).all(axis=1))


def _larger(now: Float[np.ndarray, " block"], then: Float[np.ndarray, " earlier"]) -> float:
    return float(mannwhitneyu(now, then, alternative="greater").pvalue)


def reference(passport: Passport, unit: str, load: str = "") -> tuple[Labels, list[Path]]:
    """The last session of a unit under a load, and its recordings.

    Args:
        passport: with the unit in it.
        unit: name; "" for the only one.
        load: name; "" for none, or the only one.

    Raises:
        UserError: there is no such unit, it carried no such load, or its recordings are not where
            they were.
    """
    units = passport.units
    if not unit and len(units) == 1:
        (unit,) = units
    if unit not in units:
        raise UserError(f"--unit '{unit}' is not in the passport; {suggest(unit, units)}")
    loads = sorted({g.load for g in passport.groups if g.unit == unit})
    load = load or (loads[0] if len(loads) == 1 else UNLOADED)
    if load not in loads:
        raise UserError(f"--load '{load}' was never carried by {unit}; {suggest(load, loads)}")
    same = [g for g in passport.groups if (g.unit, g.load) == (unit, load)]
    labels = max(same, key=lambda g: g.session)
    there, _ = still_there(passport.sources)
    paths = [path for path, source in there.items() if source.labels == labels]
    if not paths:
        raise UserError(
            f"the recordings of {labels} are not where they were: put them back, or add new ones "
            "with wt passport add"
        )
    return labels, paths


def as_in(passport: Passport, labels: Labels) -> Hypothesis:
    """The passport's effects with the parameters that one group has."""
    known = {r.quantity: r.value for r in passport.rows if r.labels == labels}
    return tuple(_with(planted, known) for planted in passport.hypothesis)


def _with(planted: Planted, known: Mapping[Any, float]) -> Planted:
    theta = planted.theta.copy()
    here = {
        q.parameter: value
        for q, value in known.items()
        if (q.effect, q.kind, q.place) == planted.key
    }
    for p, rows in planted.effect.rows():
        names = [f"{p.name}.{axis}" for axis in p.axes] or [p.name]
        theta[rows] = [here.get(name, old) for name, old in zip(names, theta[rows], strict=True)]
    return Planted(planted.effect, planted.at, theta)
