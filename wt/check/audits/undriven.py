"""Columns of joints that no drive moves: their weight and inertia have to hold each other."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import ClassVar

import mujoco
import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.audits.unit import UNITS
from wt.check.balance import Balance, Edit
from wt.check.channels import WRONG, Undone, columns_of
from wt.check.finding import AuditFinding

_WRONG, _RIGHT = 0.25, 0.02
"""Of the inertia's force, that nobody supplies: as recorded, and once a mix-up is undone."""
_DECISIVE = 20.0  # what nobody supplies as recorded, over after
_ALIKE = 4.0  # … of two mix-ups that cannot be told apart
_LEAST = 0.05  # rad: smaller swings are the same in any unit
_QUARTERS = (0.5 * math.pi, -0.5 * math.pi)


@register
class Undriven:
    """A pendulum's or a pole's encoder counts in the model's direction, unit and from its zero.

    Friction, a rotor or another load may be missing there: none of them makes the forces of a
    motion agree as closely as undoing what was done to its column.
    """

    kinds: ClassVar[tuple[str, ...]] = ("encoder_sign", "position_unit", "encoder_zero")
    stage: ClassVar[Stage] = "joint"
    alone: ClassVar[bool] = False
    """Whether every command has to be explained once its column is right."""

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one for each joint."""
        balance, recording = subject.balance, subject.recording
        if balance is None or recording is None:
            return
        for i in balance.idle:
            hinge = balance.scene.model.jnt_type[i] == int(mujoco.mjtJoint.mjJNT_HINGE)
            given = balance.unheld(i)
            if not hinge or given < _WRONG:
                continue
            mixups = _mixups(balance, i)
            left = {said: balance.unheld(i, [edit]) for said, edit in mixups.items()}
            best = min(left, key=lambda said: left[said])
            if left[best] > min(_RIGHT, given / _DECISIVE):
                continue
            edit, name = mixups[best], balance.joint(i)
            commands = balance.unexplained([edit])
            least = WRONG if self.alone else np.maximum(WRONG, balance.unexplained())
            if (commands > least).any():
                continue
            alike = [s for s, x in left.items() if s != best and x < _ALIKE * left[best]]
            also = f"; it cannot be told from this: {', or '.join(alike)}" if alike else ""
            columns = columns_of(balance, [edit], recording)
            yield AuditFinding(
                _kind(edit),
                tuple(columns),
                (f"joint {name}",),
                f"No drive moves {name}, and as recorded {100 * given:.0f} % of the force that its "
                f"inertia takes come from nowhere; {100 * left[best]:.1g} % if {best}{also}",
                _fix(edit, columns),
                0.7 if alike else 1.0 - left[best] / given,
                change=Undone(balance, (edit,)),
            )


@register
class UndrivenAlone(Undriven):
    """The same where nothing else is wrong.

    To what a drive moves, a pole whose zero is half a turn off counts backwards, and only the pole
    itself says what it is; but a pole also looks as if it did where what carries it does.
    """

    stage: ClassVar[Stage] = "gain"
    alone: ClassVar[bool] = True


def _mixups(balance: Balance, i: int) -> dict[str, Edit]:
    """What may have been done to the column of a degree of freedom, and what undoes it."""
    name, q = balance.joint(i), balance.signals.q[:, i]
    swept = float(np.ptp(q))
    half = -math.copysign(math.pi, float(np.median(q)))
    units = {unit: factor for unit, factor in UNITS.items() if factor * swept > _LEAST}
    return {
        f"{name}'s encoder counts backwards": Edit("q", i, i, -1.0),
        **{f"'qpos/{name}' is in {unit}": Edit("q", i, i, f) for unit, f in units.items()},
        **{
            f"{name}'s zero is {math.degrees(-turn):.0f}° off": Edit("q", i, i, 1.0, turn)
            for turn in (half, *_QUARTERS)
        },
    }


def _kind(edit: Edit) -> str:
    if edit.offset:
        return "encoder_zero"
    return "encoder_sign" if edit.factor == -1.0 else "position_unit"


def _fix(edit: Edit, columns: list[str]) -> str:
    """The entry of a map."""
    if edit.offset:
        return f"offsets: {{{columns[0]}: {edit.offset:.5g}}}"
    key, value = ("signs", "-1") if edit.factor == -1.0 else ("units", f"{edit.factor:.6g}")
    return f"{key}: {{{', '.join(f'{name}: {value}' for name in columns)}}}"
