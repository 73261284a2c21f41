"""One channel in another unit than the model: degrees, turns, ticks, percent, behind a gear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float

from wt.check.audit import Suspect, register
from wt.check.balance import Balance, Edit, Row

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
        """The named units, and the factor that fits best, of each channel that is unexplained."""
        listed: list[Suspect] = []
        left = balance.unexplained()
        for row, share in zip(balance.rows, left, strict=True):
            if share > 0.05:
                listed += _of(balance, row)
        return listed


def _of(balance: Balance, row: Row) -> list[Suspect]:
    drive, joint = row.drive, row.drive.dof
    hinge = balance.scene.model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE)
    known = UNITS if hinge else LINEAR
    listed = []
    for group, index, column, quantity in (
        ("q", joint, f"qpos/{drive.joint}", "position"),
        ("u", drive.index, f"ctrl/{drive.name}", "command"),
    ):
        if group == "u" and not drive.servo:
            continue  # a force in another unit is a gain, and physics
        for name, factor in known.items():
            edit = Edit(group, index, index, factor, _middle(balance, row, group, factor))  # type: ignore[arg-type]
            listed.append(
                Suspect(
                    f"{quantity}_unit",
                    (edit,),
                    f"'{column}' is in {name}",
                    "",
                    (f"joint {drive.joint}" if group == "q" else f"actuator {drive.name}",),
                )
            )
        if not balance.dynamic and _bearable(balance, row):
            continue  # under a load that nobody knows a soft servo moves less than it is told
        fitted = _fitted(balance, row, group, index)
        if fitted is None or any(abs(abs(fitted) / f - 1.0) < _NEAR for f in known.values()):
            continue
        ratio = 1.0 / abs(fitted)
        said = f"{ratio:.4g}" if ratio >= 1.0 else f"1/{1 / ratio:.4g}"
        edit = Edit(group, index, index, fitted, _middle(balance, row, group, fitted))  # type: ignore[arg-type]
        listed.append(
            Suspect(
                f"{quantity}_scale",
                (edit,),
                f"'{column}' is {said} times the model's, as behind a gear or in ticks",
                "",
                (f"joint {drive.joint}" if group == "q" else f"actuator {drive.name}",),
            )
        )
    return listed


def _bearable(balance: Balance, row: Row) -> bool:
    """Tell whether the drive, and what it stands on, can bear the force that the columns say."""
    s, drive, m = balance.signals, row.drive, balance.scene.model
    force = drive.unclamped(s.u[:, drive.index], s.q[:, drive.dof], s.v[:, drive.dof])
    lever = float(m.body_mass.sum() * np.linalg.norm(m.opt.gravity) * m.stat.extent)
    most = min(max(abs(f) for f in drive.forces), lever / abs(drive.gear))
    return float(np.quantile(np.abs(force), _BORNE)) < most


def _middle(balance: Balance, row: Row, group: str, factor: float) -> float:
    """Offset after which a servo's column lies about its counterpart; 0 if it does without."""
    s, drive = balance.signals, row.drive
    if not drive.servo:
        return 0.0
    q, u = s.q[:, drive.dof], s.u[:, drive.index]
    wanted, given = (u, q) if group == "q" else (q, u)
    shift = float(np.median(wanted) - factor * np.median(given))
    return shift if abs(shift) > 0.5 * max(float(np.ptp(wanted)), 0.2) else 0.0


def _fitted(balance: Balance, row: Row, group: str, index: int) -> float | None:
    """Factor that fits best; None if it may be physics."""
    s, drive = balance.signals, row.drive
    if drive.servo:
        q, u = s.q[:, drive.dof], s.u[:, drive.index]
        wanted, given = (u, q) if group == "q" else (q, u)
        if given.std() < 1e-9 or abs(np.corrcoef(wanted, given)[0, 1]) < 0.8:
            return None
        factor = float(np.polyfit(given, wanted, 1)[0])
        factor = _refined(balance, row, group, index, factor * np.linspace(0.8, 1.25, 10))
    else:
        factor = _refined(balance, row, group, index, _GRID)
        factor = _refined(balance, row, group, index, factor * np.geomspace(0.6, 1.7, 9))
    factor = _refined(balance, row, group, index, factor * np.linspace(0.95, 1.05, 5))
    return None if _ORDINARY[0] < abs(factor) < _ORDINARY[1] else factor


def _refined(
    balance: Balance, row: Row, group: str, index: int, factors: Float[np.ndarray, " trial"]
) -> float:
    at = balance.rows.index(row)
    left = [
        balance.unexplained(
            [Edit(group, index, index, float(f), _middle(balance, row, group, float(f)))]  # type: ignore[arg-type]
        )[at]
        for f in factors
    ]
    return float(factors[int(np.argmin(left))])
