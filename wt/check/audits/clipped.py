"""Measurements cut off at the end of a range, while the joint goes on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding, Change
from wt.check.velocity import belongs
from wt.data.recording import coordinate
from wt.types import Recording

_LEAST = 0.01  # of all samples, at one end
_RUN = 5
_FAST = 0.3  # of the usual slope: what the other quantity says meanwhile


@register
class Clipped:
    """A position or velocity that stays at exactly its largest value while the joint moves on."""

    kinds: ClassVar[tuple[str, ...]] = ("clipped",)
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each clipped column."""
        recording = subject.recording
        if recording is None:
            return
        for name in recording.columns:
            group, _, joint = name.partition("/")
            if group not in ("qpos", "qvel") or coordinate(joint) is not None:
                continue
            if not belongs(recording, joint):
                continue
            at = _at_end(recording.columns[name])
            if at is not None and _moves(recording, joint, group, at):
                end = float(np.nanmedian(recording.columns[name][at]))
                yield AuditFinding(
                    "clipped",
                    (name,),
                    (f"joint {joint}",),
                    f"'{name}' stays at exactly {end:.4g} for {at.sum()} samples, while "
                    f"'{'qvel' if group == 'qpos' else 'qpos'}/{joint}' says that it goes on",
                    "widen the range of the sensor or of the log; clipped samples are missing ones",
                    change=_missing(name, end),
                )


def _at_end(column: Float[np.ndarray, " sample"]) -> Bool[np.ndarray, " sample"] | None:
    """Samples at an extreme value that is held."""
    for end in (np.nanmax(column), np.nanmin(column)):
        at = column == end
        if at.mean() < _LEAST:
            continue
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]))))[::2]
        if np.median(runs) >= _RUN:
            return np.asarray(at)
    return None


def _moves(recording: Recording, joint: str, group: str, at: Bool[np.ndarray, " sample"]) -> bool:
    """Tell whether the joint's other column says that it goes on."""
    t = recording.t
    if group == "qpos":
        v = recording.columns[f"qvel/{joint}"]
        return bool(np.nanmean(np.abs(v[at])) > _FAST * np.nanstd(v))
    slope = np.gradient(recording.columns[f"qpos/{joint}"], t)
    end = np.abs(recording.columns[f"qvel/{joint}"][at][0])
    return bool(np.nanmedian(np.abs(slope[at])) > 1.1 * end)


def _missing(name: str, end: float) -> Change:
    def change(recording: Recording) -> Recording:
        column = recording.columns[name]
        cut = np.where(column == end, np.nan, column)
        return replace(recording, columns={**recording.columns, name: cut})

    return change
