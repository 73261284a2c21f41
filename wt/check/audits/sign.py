"""Encoders that count backwards, and commands with the other sign."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from wt.check.audit import Suspect, register
from wt.check.balance import Balance, Edit


@register
class Sign:
    """One column runs against the model's direction."""

    kinds: ClassVar[tuple[str, ...]] = ("encoder_sign", "command_sign")

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """Every measured joint, and every command."""
        listed = []
        for i in range(len(balance.scene.joints)):
            if balance.signals.measured[i] and balance.joint(i) in balance.scene.own_joints:
                name = balance.joint(i)
                listed.append(
                    Suspect(
                        "encoder_sign",
                        (Edit("q", i, i, -1.0),),
                        f"{name}'s encoder counts backwards",
                        "",
                        (f"joint {name}",),
                    )
                )
        for row in balance.rows:
            name, i = row.drive.name, row.drive.index
            listed.append(
                Suspect(
                    "command_sign",
                    (Edit("u", i, i, -1.0),),
                    f"{name}'s command has the other sign",
                    "",
                    (f"actuator {name}",),
                )
            )
        return listed
