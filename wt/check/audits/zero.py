"""Encoders whose zero is elsewhere than the model's: by a quarter turn, or far from the command.

A small offset is physics, and at a joint that feels no weight it cannot be told from a bias of its
drive. One of a quarter or half a turn is another convention.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Bool

from wt.check.audit import Stage, Subject, Suspect, register
from wt.check.balance import Balance, Edit, Row
from wt.check.finding import AuditFinding

_QUARTERS = (math.pi, 0.5 * math.pi, -0.5 * math.pi)
_FAR = 0.35  # rad
_EXPLAINED = 0.1  # of every force, that may be left where nothing else is wrong
_RIGHT = 0.3  # of its command that a joint leaves unexplained, at most
_OFTEN = 0.5  # of the poses in which something holds a joint, at least, to be why it stays away
_FORCES = 3.0  # times all that the motion demands: no bias of a drive is so large


@register
class QuarterTurn:
    """A joint under a torque drive whose weight pulls as at another angle."""

    kinds: ClassVar[tuple[str, ...]] = ("encoder_zero",)

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """Each driven hinge that no servo holds, turned by quarters."""
        hinge = int(mujoco.mjtJoint.mjJNT_HINGE)
        return [
            Suspect(
                "encoder_zero",
                (Edit("q", row.drive.dof, row.drive.dof, 1.0, turn),),
                f"{row.drive.joint}'s zero is {math.degrees(turn):.0f}° off"
                + (", or the base turned about its axle" if _first(balance, row.drive.dof) else ""),
                "",
                (f"joint {row.drive.joint}",),
            )
            for row in balance.rows
            if not row.drive.servo and balance.scene.model.jnt_type[row.drive.dof] == hinge
            for turn in _QUARTERS
        ]


def one_zero(balance: Balance) -> bool:
    """Tell whether one joint's zero explains every force, and no limit is against it.

    So would the base, turned about that joint's axle.
    """
    return any(
        balance.unexplained_forces(s.edits).max() < _EXPLAINED
        and balance.beyond(s.edits) <= balance.beyond()
        for s in (*QuarterTurn().suspects(balance), *AwayFromCommand().suspects(balance))
    )


def _first(balance: Balance, dof: int) -> bool:
    """Tell whether a joint carries all that moves: its zero and the base's are then one."""
    m = balance.scene.model
    body = int(m.dof_bodyid[dof])
    moving = [m.body(name).id for name in balance.scene.moving]
    return m.body_dofnum[body] == 1 and all(_carries(m, body, b) for b in moving)


def _carries(m: mujoco.MjModel, body: int, other: int) -> bool:
    """Tell whether a body is another one, or what that hangs on."""
    while other > body:
        other = int(m.body_parentid[other])
    return other == body


@register
class AwayFromCommand:
    """A servo's joint whose weight, and whose inertia to others, are those of where it was sent."""

    kinds: ClassVar[tuple[str, ...]] = ("encoder_zero",)

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """Each hinge that stays far from its command, at it."""
        if not balance.dynamic:
            return []
        hinge = int(mujoco.mjtJoint.mjJNT_HINGE)
        listed = []
        for row in balance.rows:
            drive, i = row.drive, row.drive.dof
            away = _away(balance, row) if drive.servo else 0.0
            if abs(away) < _FAR or balance.scene.model.jnt_type[i] != hinge:
                continue
            zero = _unloaded(balance, i, abs(drive.bias[1]) * drive.gear**2, away)
            listed.append(
                Suspect(
                    "encoder_zero",
                    (Edit("q", i, i, 1.0, zero),),
                    f"{drive.joint}'s zero is {math.degrees(zero):.0f}° off",
                    "",
                    (f"joint {drive.joint}",),
                )
            )
        return listed


def _away(balance: Balance, row: Row) -> float:
    """How far a servo's joint usually stays below what its command holds [rad or m]."""
    s, drive = balance.signals, row.drive
    return float(np.median(drive.held_per_command * s.u[:, drive.index] - s.q[:, drive.dof]))


@register
class FarFromCommand:
    """A servo's joint that follows its command at a distance which no force explains."""

    kinds: ClassVar[tuple[str, ...]] = ("encoder_zero",)
    stage: ClassVar[Stage] = "range"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """One for each such joint."""
        balance = subject.balance
        if balance is None or not balance.dynamic:
            return
        s = balance.signals
        demand, held = balance.inverse(s.q, s.v, s.a), None
        for row, left in zip(balance.rows, balance.unexplained(), strict=True):
            drive, i = row.drive, row.drive.dof
            if not drive.servo or left > _RIGHT:
                continue
            stiffness = abs(drive.bias[1]) * drive.gear**2
            away, most = _away(balance, row), float(np.abs(demand[:, i]).max())
            if abs(away) < _FAR or stiffness * abs(away) < _FORCES * most:
                continue
            held = _held(balance) if held is None else held
            if held[i]:
                continue
            zero = _unloaded(balance, i, stiffness, away)
            name = f"qpos/{drive.joint}"
            yield AuditFinding(
                "encoder_zero",
                (name,),
                (f"joint {drive.joint}",),
                f"'{name}' stays {abs(away):.3g} {'below' if away > 0 else 'above'} its command, "
                f"which would take {stiffness * abs(away):.3g} of force and the motion at most "
                f"{most:.3g}: the encoder has another zero",
                f"offsets: {{{name}: {zero:.4g}}}",
                change=lambda r, name=name, zero=zero: replace(  # type: ignore[misc]
                    r, columns={**r.columns, name: r.columns[name] + zero}
                ),
            )


def _held(balance: Balance) -> Bool[np.ndarray, " dof"]:
    """Degrees of freedom that what they touch keeps from where they are sent to.

    In the model, at half of the recording's poses or more. No stop holds what is far beyond it.
    """
    m = mujoco.MjModel.__copy__(balance.scene.model)
    middle = np.median(balance.signals.q, axis=0)
    low, high = m.jnt_range[m.dof_jntid].T
    m.jnt_limited[m.dof_jntid[(middle < low - _FAR) | (middle > high + _FAR)]] = False
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    d = mujoco.MjData(m)
    held = np.zeros((len(balance.signals.q), m.nv), dtype=bool)
    for here, q in zip(held, balance.signals.q, strict=True):
        d.qpos[:] = q
        mujoco.mj_forward(m, d)
        here[:] = d.qfrc_constraint != 0.0
    return np.asarray(np.mean(held, axis=0) >= _OFTEN)


def _unloaded(balance: Balance, dof: int, stiffness: float, away: float) -> float:
    """Offset of an encoder, less what its load makes a servo stay behind.

    Args:
        balance: of the recording.
        dof: the joint.
        stiffness: force per position.
        away: distance from the command, load and all [rad or m].
    """
    s = balance.signals
    q = s.q.copy()
    q[:, dof] += away
    return away - float(np.median(balance.inverse(q, s.v, s.a)[:, dof])) / stiffness
