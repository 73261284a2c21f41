"""One channel in another unit than the model: degrees, turns, ticks, percent, behind a gear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Literal, get_args

import mujoco
import numpy as np
from jaxtyping import Float

from wt.check.audit import Suspect, register
from wt.check.balance import GAINS, Balance, Edit, Row
from wt.check.channels import FAINT

Group = Literal["q", "u"]
_GROUPS: tuple[Group, ...] = get_args(Group)
UNITS = {
    "degrees": math.pi / 180.0,
    "turns": 2.0 * math.pi,
    "ticks of 4096 a turn": 2.0 * math.pi / 4096.0,
    "ticks of 1024 a turn": 2.0 * math.pi / 1024.0,
    "ticks of 16384 a turn": 2.0 * math.pi / 16384.0,
}
"""Factors to radians."""
LINEAR = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}
"""Factors to metres."""
_NEAR = 0.04  # of a factor, for its unit to be named
_TICKS = 10.0  # that a motion takes at least
_ORDINARY = (0.6, 1.7)  # factors that physics may explain: a gain, a scale
_BORNE = 0.99
"""Share of a recording in which a force must be one that can be borne."""
_GRID = np.geomspace(1e-4, 1e4, 33)


@register
class Unit:
    """A position or command column is so many times what it should be."""

    kinds: ClassVar[tuple[str, ...]] = ("position_unit", "command_unit", "position_scale",
                                        "command_scale")  # fmt: skip

    def suspects(self, balance: Balance) -> Sequence[Suspect]:
        """The named units, and the factor that fits best, of each channel that is unexplained.

        And each unit of several of them: an encoder's is seldom alone.
        """
        wrong = [
            row
            for row, share in zip(balance.rows, balance.unexplained(), strict=True)
            if share > FAINT
        ]
        if not wrong:
            return []
        several = [s for group in _GROUPS for s in _of_several(balance, group)]
        return [suspect for row in wrong for suspect in _of(balance, row)] + several


def _told(group: Group, row: Row) -> bool:
    """Tell whether a channel has units: a force in another one is a gain."""
    return group == "q" or row.drive.servo


def _known(balance: Balance, row: Row) -> dict[str, float]:
    """Units that a joint's channels may be in."""
    hinge = balance.scene.model.jnt_type[row.drive.dof] == int(mujoco.mjtJoint.mjJNT_HINGE)
    return UNITS if hinge else LINEAR


def _possible(balance: Balance, row: Row, group: Group, unit: str) -> bool:
    """Tell whether a channel may be in a unit: ticks are whole, and a motion takes many of them."""
    s = balance.signals
    column = s.q[:, row.drive.dof] if group == "q" else s.u[:, row.drive.index]
    return not unit.startswith("ticks") or float(np.ptp(column)) > _TICKS


def _of(balance: Balance, row: Row) -> list[Suspect]:
    listed = []
    for group in _GROUPS:
        known = _known(balance, row) if _told(group, row) else {}
        for name, factor in known.items():
            if not _possible(balance, row, group, name):
                continue
            said = f"{_column(group, row)} is in {name}"
            for f, words in ((factor, said), (-factor, f"{said} and runs backwards")):
                suspect = _suspect(balance, group, [row], [f], "unit", words)
                listed.append(suspect)
                if name.startswith("ticks") and not row.drive.servo:
                    # where no command tells the zero: encoders without a sign have it amid a turn
                    (edit,) = suspect.edits
                    amid = replace(edit, offset=-math.copysign(math.pi, f))
                    listed.append(replace(suspect, edits=(amid,)))
        if not balance.dynamic and _bearable(balance, row):
            continue  # under a load that nobody knows a soft servo moves less than it is told
        for fitted in _fitted(balance, row, group):
            if any(abs(abs(fitted) / f - 1.0) < _NEAR for f in known.values()):
                continue
            ratio = 1.0 / abs(fitted)
            said = f"{ratio:.4g}" if ratio >= 1.0 else f"1/{1 / ratio:.4g}"
            said = (
                f"{_column(group, row)} is {said} times the model's, as behind a gear or in ticks"
            )
            listed.append(_suspect(balance, group, [row], [fitted], "scale", said))
    return listed


def _of_several(balance: Balance, group: Group) -> list[Suspect]:
    """One unit of all hinges, or slides, or of those whose servos say that they are in it."""
    listed = []
    for units in (UNITS, LINEAR):
        rows = [r for r in balance.rows if _known(balance, r) is units and _told(group, r)]
        for name, factor in units.items():
            followed = [r for r in rows if _follows(balance, r, group, factor)]
            for same in [rows] if followed == rows else [rows, followed]:
                if len(same) < 2 or not all(_possible(balance, r, group, name) for r in same):
                    continue
                *names, last = (_column(group, row) for row in same)
                said = f"{', '.join(names)} and {last} are in {name}"
                listed.append(_suspect(balance, group, same, [factor] * len(same), "unit", said))
    return listed


def _follows(balance: Balance, row: Row, group: Group, factor: float) -> bool:
    """Tell whether a servo's column is to its counterpart as one in a unit is."""
    if not row.drive.servo:
        return False
    given, wanted = _counterparts(balance, row, group)
    factor *= float(given.std()) / max(float(wanted.std()), 1e-12)
    return _ORDINARY[0] < factor < _ORDINARY[1]


def _counterparts(
    balance: Balance, row: Row, group: Group
) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, " row"]]:
    """A servo's channel, and what it would be if the other one were followed exactly."""
    s, drive = balance.signals, row.drive
    q, u, held = s.q[:, drive.dof], s.u[:, drive.index], drive.held_per_command
    return (q, held * u) if group == "q" else (u, q / held)


def _column(group: Group, row: Row) -> str:
    return f"'qpos/{row.drive.joint}'" if group == "q" else f"'ctrl/{row.drive.name}'"


def _suspect(
    balance: Balance,
    group: Group,
    rows: Sequence[Row],
    factors: Sequence[float],
    what: Literal["unit", "scale"],
    said: str,
) -> Suspect:
    drives = [row.drive for row in rows]
    indices = [d.dof if group == "q" else d.index for d in drives]
    edits = [
        Edit(group, i, i, factor, _middle(balance, row, group, factor))
        for row, i, factor in zip(rows, indices, factors, strict=True)
    ]
    elements = [f"joint {d.joint}" if group == "q" else f"actuator {d.name}" for d in drives]
    kind = f"{'position' if group == 'q' else 'command'}_{what}"
    return Suspect(kind, tuple(edits), said, "", tuple(elements))


def _bearable(balance: Balance, row: Row) -> bool:
    """Tell whether the drive, and what it stands on, can bear the force that the columns say."""
    s, drive, m = balance.signals, row.drive, balance.scene.model
    force = drive.unclamped(s.u[:, drive.index], s.q[:, drive.dof], s.v[:, drive.dof])
    lever = float(m.body_mass.sum() * np.linalg.norm(m.opt.gravity) * m.stat.extent)
    most = min(max(abs(f) for f in drive.forces), lever / abs(drive.gear))
    return float(np.quantile(np.abs(force), _BORNE)) < most


def _middle(balance: Balance, row: Row, group: Group, factor: float) -> float:
    """Offset after which a servo's column lies about its counterpart; 0 if it does without."""
    if not row.drive.servo:
        return 0.0
    given, wanted = _counterparts(balance, row, group)
    shift = float(np.median(wanted) - factor * np.median(given))
    return shift if abs(shift) > 0.5 * max(float(np.ptp(wanted)), 0.2) else 0.0


def _fitted(balance: Balance, row: Row, group: Group) -> list[float]:
    """Factors that fit best, and are none that may be physics."""
    if row.drive.servo:
        given, wanted = _counterparts(balance, row, group)
        if given.std() < 1e-9 or abs(np.corrcoef(wanted, given)[0, 1]) < 0.8:
            return []
        factor = float(np.polyfit(given, wanted, 1)[0])
        factor = _refined(balance, row, group, factor * np.linspace(0.8, 1.25, 10))
    elif group == "q":
        factor = _refined(balance, row, group, _GRID)
        factor = _refined(balance, row, group, factor * np.geomspace(0.6, 1.7, 9))
    else:
        return _gains(balance, row)
    factor = _refined(balance, row, group, factor * np.linspace(0.95, 1.05, 5))
    return [] if _ORDINARY[0] < abs(factor) < _ORDINARY[1] else [factor]


def _gains(balance: Balance, row: Row) -> list[float]:
    """Factors of a torque drive's command, of either sign, that no gain explains."""
    at, i = balance.rows.index(row), row.drive.index
    gains = {sign: float(balance.gains([Edit("u", i, i, sign)])[at]) for sign in (1.0, -1.0)}
    return [
        sign / gain
        for sign, gain in gains.items()
        if gain > 0.0 and not GAINS[0] <= gain <= GAINS[1]
    ]


def _refined(
    balance: Balance, row: Row, group: Group, factors: Float[np.ndarray, " trial"]
) -> float:
    trials = [_suspect(balance, group, [row], [float(f)], "scale", "") for f in factors]
    left = [balance.unexplained_of(row, trial.edits) for trial in trials]
    return float(factors[int(np.argmin(left))])
