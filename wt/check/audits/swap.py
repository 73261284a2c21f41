"""Columns that were exchanged: positions, or commands, two or a whole cycle of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import ClassVar, Literal

from wt.check.audit import Suspect, register
from wt.check.balance import Balance, Edit
from wt.check.channels import WRONG, total, whole
from wt.check.order import Order, by_exchanges


@register
class Swap:
    """Columns stand at each other's place, as where a log has another order than the model."""

    kinds: ClassVar[tuple[str, ...]] = ("positions_swapped", "commands_swapped", "joints_swapped")

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """Every pair of measured joints, of commands and of both, and what order explains most."""
        driven = {row.drive.dof for row in balance.rows}
        joints = [
            i
            for i, name in enumerate(balance.scene.joints)
            if balance.signals.measured[i] and name in balance.scene.own_joints
        ]
        positions = [p for p in itertools.combinations(joints, 2) if driven & set(p)]
        commands = list(itertools.combinations([row.drive.index for row in balance.rows], 2))
        return [*_of(balance, "q", positions), *_of(balance, "u", commands), *_joints(balance)]


def _joints(balance: Balance) -> list[Suspect]:
    """Pairs of wrong joints, with their commands: neither exchange alone explains anything.

    Torque drives show it by themselves, and servos whose gears differ.
    """
    wrong = zip(balance.rows, balance.unexplained() > WRONG, strict=True)
    rows = [row for row, is_wrong in wrong if is_wrong]
    listed = []
    for a, b in itertools.combinations(rows, 2):
        one = _suspect(balance, "q", {a.drive.dof: b.drive.dof, b.drive.dof: a.drive.dof})
        i, j = a.drive.index, b.drive.index
        listed.append(whole(one, _suspect(balance, "u", {i: j, j: i})))
    return listed


def _of(
    balance: Balance, group: Literal["q", "u"], pairs: Sequence[tuple[int, int]]
) -> list[Suspect]:
    orders = [{i: j, j: i} for i, j in pairs]
    order = _sorted(balance, group, pairs)
    if len(order) > 2:
        orders.append(order)
    return [_suspect(balance, group, order) for order in orders]


def _sorted(balance: Balance, group: Literal["q", "u"], pairs: Sequence[tuple[int, int]]) -> Order:
    """The order that explains most, by exchanging two columns as long as that helps."""
    left = balance.unexplained()
    right = {
        row.drive.dof if group == "q" else row.drive.index
        for row, share in zip(balance.rows, left, strict=True)
        if share <= WRONG
    }
    pairs = [pair for pair in pairs if not right.issuperset(pair)]
    order, _ = by_exchanges(pairs, lambda o: total(balance.unexplained(_edits(group, o))))
    return order


def _edits(group: Literal["q", "u"], order: Order) -> tuple[Edit, ...]:
    return tuple(Edit(group, channel, column) for channel, column in sorted(order.items()))


def _suspect(balance: Balance, group: Literal["q", "u"], order: Order) -> Suspect:
    of_joints = group == "q"
    model, items = balance.scene.model, sorted(order.items())
    name = {i: balance.joint(i) if of_joints else model.actuator(i).name for i, _ in items}
    *names, last = name.values()
    said = f"the {'positions' if of_joints else 'commands'} of {', '.join(names)} and {last}"
    said += " are exchanged"
    if len(order) > 2:
        said += " (" + ", ".join(f"{name[i]}'s is called {name[j]}" for i, j in items) + ")"
    entries = ", ".join(f"{name[column]}: {name[i]}" for i, column in items)
    return Suspect(
        "positions_swapped" if of_joints else "commands_swapped",
        _edits(group, order),
        said,
        f"joints: {{{entries}}}"
        if of_joints
        else f"commands: {{{entries}}}, or the other order of actuators in the MJCF",
        tuple(f"{'joint' if of_joints else 'actuator'} {n}" for n in name.values()),
    )
