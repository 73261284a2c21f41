"""Velocities that are not the slopes of their positions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding, Change, leave_out
from wt.check.velocity import Relation, related
from wt.types import Recording

UNITS = {
    "deg": (180.0 / math.pi, "degrees a second"),
    "rpm": (60.0 / (2.0 * math.pi), "turns a minute"),
    "rev": (1.0 / (2.0 * math.pi), "turns a second"),
}
"""Factors from rad/s, by the word of a map."""
_ALIKE, _STRANGE = 0.9, 0.7
_DECISIVE = 10.0  # what a slope leaves of a velocity's variance, over what another joint's leaves
_NEAR = 0.08
_SCALED = (0.7, 1.4)  # what filters and noise may make of a factor
_LATE_S, _LATE_SAMPLES = 0.03, 2.5
_FAR = 4.0  # times that: no filter is so slow


@register
class Velocity:
    """``qvel`` is what ``qpos`` changes by: in sign, in unit, at its own joint, in time."""

    kinds: ClassVar[tuple[str, ...]] = ("velocity_sign", "velocity_unit", "velocity_scale",
                                        "velocities_swapped", "velocity_other",
                                        "velocity_late")  # fmt: skip
    stage: ClassVar[Stage] = "velocity"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one for each velocity."""
        recording = subject.recording
        if recording is None:
            return
        joints = [c.removeprefix("qpos/") for c in recording.columns if c.startswith("qpos/")]
        joints = [j for j in joints if f"qvel/{j}" in recording.columns]
        unlike, strange = dict[str, Relation](), list[str]()
        for joint in joints:
            relation = related(recording, joint, joint)
            if relation is None:
                continue
            another = _another(recording, relation)
            if another or abs(relation.correlation) < _ALIKE:
                unlike[joint] = relation
            else:
                yield from _scaled(recording, joint, relation)
            if another or abs(relation.correlation) < _STRANGE:
                strange.append(joint)
        yield from _strangers(recording, unlike, strange)


def _another(recording: Recording, relation: Relation) -> bool:
    """Tell whether a velocity is like its slope at another time only, and not as large.

    An acceleration goes ahead of it, or far behind with the other sign; filters and slow logs come
    a little behind, and what they leave is as large.
    """
    usual = max(_LATE_S, _LATE_SAMPLES * _interval(recording))
    like = abs(relation.correlation) > _ALIKE and _SCALED[0] < relation.factor < _SCALED[1]
    return not like and not -usual <= relation.late <= _FAR * usual


def _scaled(recording: Recording, joint: str, relation: Relation) -> Iterable[AuditFinding]:
    name, factor = f"qvel/{joint}", relation.factor
    size = abs(factor)
    late = relation.late > max(_LATE_S, _LATE_SAMPLES * _interval(recording))
    said = f"'{name}' is {factor:.3g} times the slope of 'qpos/{joint}'"
    unit = next((u for u, (f, _) in UNITS.items() if abs(size / f - 1.0) < _NEAR), None)
    if unit:
        exact, words = UNITS[unit]
        change = _times(name, math.copysign(1.0 / exact, factor))
        yield AuditFinding(
            "velocity_unit", (name,), (), f"{said}: it is in {words}", f"units: {{{name}: {unit}}}",
            change=change,
        )  # fmt: skip
    elif not _SCALED[0] < size < _SCALED[1] and not (late and 0.0 < factor < 1.0):
        yield AuditFinding(
            "velocity_scale", (name,), (), said, f"units: {{{name}: {1.0 / factor:.4g}}}",
            change=_times(name, 1.0 / factor),
        )  # fmt: skip
    elif factor < 0.0:
        yield AuditFinding(
            "velocity_sign",
            (name,),
            (),
            f"'{name}' runs against the slope of 'qpos/{joint}'",
            f"signs: {{{name}: -1}}",
            change=_times(name, -1.0),
        )
    elif late:
        yield AuditFinding(
            "velocity_late",
            (name,),
            (),
            f"'{name}' comes {1e3 * relation.late:.0f} ms behind the slope of 'qpos/{joint}': it "
            "was filtered, or logged late",
            f"leave '{name}' out; the slope of the position is the better velocity",
            change=leave_out(name),
        )


def _interval(recording: Recording) -> float:
    return float(np.median(np.diff(recording.t)))


def _times(name: str, factor: float) -> Change:
    def change(recording: Recording) -> Recording:
        columns = recording.columns
        return replace(recording, columns={**columns, name: columns[name] * factor})

    return change


def _strangers(
    recording: Recording, unlike: Mapping[str, Relation], strange: Sequence[str]
) -> Iterable[AuditFinding]:
    """Velocities unlike the slope of their own position: of other joints, or of nothing.

    Args:
        recording: their recording.
        unlike: how velocities that may be another joint's go with their own position.
        strange: those of them that are not their own joint's.
    """
    home = {
        joint: other
        for joint, own in unlike.items()
        for other in unlike
        if other != joint
        and (r := related(recording, joint, other))
        and r.correlation > _ALIKE
        and _DECISIVE * (1.0 - r.correlation**2) < 1.0 - own.correlation**2
        and _SCALED[0] < r.factor < _SCALED[1]
    }
    if home and sorted(home) == sorted(home.values()):
        names = tuple(f"qvel/{joint}" for joint in home)
        yield AuditFinding(
            "velocities_swapped",
            names,
            (),
            "; ".join(f"'qvel/{a}' is the slope of 'qpos/{b}'" for a, b in home.items()),
            "exchange the columns "
            + ", ".join(f"'qvel/{a}' → 'qvel/{b}'" for a, b in home.items()),
            change=lambda r: replace(
                r,
                columns={
                    **r.columns,
                    **{f"qvel/{b}": r.columns[f"qvel/{a}"] for a, b in home.items()},
                },
            ),
        )
        return
    for joint in strange:
        name = f"qvel/{joint}"
        yield AuditFinding(
            "velocity_other",
            (name,),
            (),
            f"'{name}' is not the slope of 'qpos/{joint}', nor a multiple of it",
            f"leave '{name}' out",
            0.9,
            change=leave_out(name),
        )
