"""Two columns that were exchanged: positions, or commands."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import ClassVar

from wt.check.audit import Suspect, register
from wt.check.balance import Balance, Edit


@register
class Swap:
    """Two columns stand at each other's place, as where a log has another order than the model."""

    kinds: ClassVar[tuple[str, ...]] = ("positions_swapped", "commands_swapped")

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """Every pair of measured joints, and of commands, that a command may tell apart."""
        listed = []
        joints = [
            i
            for i, name in enumerate(balance.scene.joints)
            if balance.signals.measured[i] and name in balance.scene.own_joints
        ]
        driven = {row.drive.dof for row in balance.rows}
        for i, j in itertools.combinations(joints, 2):
            if i in driven or j in driven:
                one, other = balance.joint(i), balance.joint(j)
                listed.append(
                    Suspect(
                        "positions_swapped",
                        (Edit("q", i, j), Edit("q", j, i)),
                        f"the positions of {one} and {other} are exchanged",
                        f"joints: {{{one}: {other}, {other}: {one}}}",
                        (f"joint {one}", f"joint {other}"),
                    )
                )
        drives = [row.drive for row in balance.rows]
        for a, b in itertools.combinations(drives, 2):
            listed.append(
                Suspect(
                    "commands_swapped",
                    (Edit("u", a.index, b.index), Edit("u", b.index, a.index)),
                    f"the commands of {a.name} and {b.name} are exchanged",
                    f"commands: {{{a.name}: {b.name}, {b.name}: {a.name}}}, or the other order of "
                    "actuators in the MJCF",
                    (f"actuator {a.name}", f"actuator {b.name}"),
                )
            )
        return listed
