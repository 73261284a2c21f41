"""Joints that were exchanged whole: a log calls one, with its command, by another's name."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance, Edit
from wt.check.channels import Undone, columns_of
from wt.check.finding import AuditFinding
from wt.check.order import Order, by_exchanges

_WRONG, _RIGHT = 0.2, 0.1
"""Shares of a drive's force that are left where joints are exchanged, and where they are not."""
_FAINT, _OVERWHELMING = 0.05, 40.0
"""Less than that is wrong, too, if the exchange divides it by so much at each of the joints."""
_DECISIVE = 8.0
"""By so much the exchange divides what is left of the worst, and of each in the geometric mean:
what a model lacks it lacks in any order."""


@register
class Joints:
    """Positions and commands of joints stand at each other's place together.

    A servo follows its command there as it should, so that only forces tell: they are those of
    another joint.
    """

    kinds: ClassVar[tuple[str, ...]] = ("joints_swapped",)
    stage: ClassVar[Stage] = "joint"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one, of all that are exchanged."""
        balance = subject.balance
        if balance is None or not balance.dynamic or subject.recording is None:
            return
        given = balance.unexplained_forces()
        if not (given > _FAINT).any():
            return
        order, unique = _sorted(balance, given)
        edits, moved = _edits(balance, order), sorted(order)
        left = balance.unexplained_forces(edits)
        ratio = given[moved] / np.maximum(left[moved], 1e-6)
        shown = ratio[given[moved] > _WRONG]
        if moved and not len(shown) and ratio.min() > _OVERWHELMING:
            shown = ratio
        if not len(shown) or shown.min() < _DECISIVE or np.log(ratio).mean() < np.log(_DECISIVE):
            return
        if not unique or (left > np.maximum(given, _RIGHT)).any() or (left[moved] > _RIGHT).any():
            return
        if balance.upset(edits, ()):
            return
        name = [balance.joint(row.drive.dof) for row in balance.rows]
        *names, last = [name[k] for k in moved]
        worst = moved[int(np.argmax(given[moved]))]
        entries = ", ".join(f"{name[order[k]]}: {name[k]}" for k in moved)
        drives = [row.drive.name for row in balance.rows]
        sent = ", ".join(f"{drives[order[k]]}: {drives[k]}" for k in moved)
        yield AuditFinding(
            "joints_swapped",
            tuple(columns_of(balance, edits, subject.recording)),
            tuple(f"joint {name[k]}" for k in moved),
            f"The joints {', '.join(names)} and {last} are exchanged, positions and commands: so "
            f"the motion explains {100.0 * (1.0 - left[worst]):.0f} % of the force of "
            f"{drives[worst]}, and as recorded {100.0 * max(0.0, 1.0 - given[worst]):.0f} %",
            f"joints: {{{entries}}}, commands: {{{sent}}}",
            change=Undone(balance, edits),
        )


def _sorted(balance: Balance, given: Float[np.ndarray, " row"]) -> tuple[Order, bool]:
    """The order of rows that explains most of the forces; whether only it does."""
    kind = [balance.scene.model.joint(row.drive.joint).type[0] for row in balance.rows]
    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(kind)), 2)
        if kind[i] == kind[j] and max(given[i], given[j]) > _FAINT
    ]
    return by_exchanges(pairs, lambda o: len(kind) * balance.misfit(_edits(balance, o)))


def _edits(balance: Balance, order: Order) -> tuple[Edit, ...]:
    drive = [row.drive for row in balance.rows]
    return tuple(
        edit
        for k, source in sorted(order.items())
        for edit in (
            Edit("q", drive[k].dof, drive[source].dof),
            Edit("u", drive[k].index, drive[source].index),
        )
    )
