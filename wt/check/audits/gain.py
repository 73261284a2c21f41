"""Gains of all servos in another unit: force per degree, a firmware's counts, five times too much.

One drive's gain is physics, and so is a weak supply's. That all servos of a machine are alike so
many times stiffer than the model's is no property of any of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance, Row
from wt.check.finding import AuditFinding
from wt.physics.scene import Amendment, Drive

UNITS = {"degrees for radians": 180.0 / math.pi, "thousandths for wholes": 1000.0}
"""Factors that gains of another unit are off by, either way."""
_UNIT_OF = {
    **{factor: unit for unit, factor in UNITS.items()},
    **{1.0 / factor: unit for unit, factor in UNITS.items()},
}
_NEAR = 0.1  # of such a factor: what friction and a weight may make of it
_NAMED = 0.04  # … where every servo alone arrives at about the same
_EXACT = 1e-3  # … where the best one is looked for
_USUAL = 3.0  # of a common factor, either way: less is a supply's, or wear
_FAR = 10.0  # … beyond which one servo that shows it does, and others may differ by their wear
_WIDE = 0.35  # of such a factor, by which drives' own gains may differ
_MOST = 3000.0  # … of any that is looked for
_DECISIVE = 5.0  # what is left of a servo's force without the factor, over with it
_FAINT, _NOTHING = 2e-3, 1e-5  # of a force, below which it tells nothing; that counts as none
_RIGHT = 0.3  # of a force, that may be left with it
_ALONE = 0.1  # … of every force, where nothing else is wrong
_LEAST = 2  # servos that show it: one drive's gain is physics
_STAYS = 0.3  # of the damping that the factor takes, by which what is missing may differ from it


@register
class GainUnit:
    """The model's servos are all alike so many times stiffer than the machine's."""

    kinds: ClassVar[tuple[str, ...]] = ("gain_unit",)
    stage: ClassVar[Stage] = "rest"
    alone: ClassVar[bool] = False
    """Whether nothing else may be wrong: what one joint lacks hides nothing of the others."""

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one, of all servos."""
        balance = subject.balance
        if balance is None or not balance.dynamic:
            return
        servos = np.array([row.drive.servo for row in balance.rows], bool)
        if servos.sum() < _LEAST:
            return
        usual = balance.unexplained_forces(gains=(1.0 / _USUAL, _USUAL))[servos]
        common = _common(balance, servos)
        if common is None and (usual > _FAINT).sum() < _LEAST:
            return
        for factor in _candidates(balance, servos, common):
            if self._shown(balance, servos, usual, factor, common is not None):
                yield _finding(balance, factor)
                return

    def _shown(
        self,
        balance: Balance,
        servos: Bool[np.ndarray, " row"],
        given: Float[np.ndarray, " servo"],
        factor: float,
        agreed: bool,
    ) -> bool:
        """Tell whether the forces are explained with a factor, and as ``given`` are not.

        Where servos agree about the factor, each by itself, the least difference will do.
        """
        if 1.0 / _USUAL < factor < _USUAL:
            return False
        left = _left(balance, factor, agreed)[servos]
        ratio = given / np.maximum(left, _NOTHING)
        telling = given > (_NOTHING if agreed else _FAINT)
        if (left > np.maximum(given, _FAINT)).any() or (left[telling] > _RIGHT).any():
            return False
        shown = telling & (ratio > _DECISIVE)
        together = telling.any() and np.log(ratio[telling]).mean() > math.log(_DECISIVE)
        least = 1 if _impossible(factor) else _LEAST
        if max(int(shown.sum()), int(telling.sum()) if together else 0) < least:
            return False
        return bool((left < _ALONE).all()) or not self.alone


@register
class GainUnitAlone(GainUnit):
    """The same where it explains every servo: else columns get units that make up for it."""

    stage: ClassVar[Stage] = "gain"
    alone: ClassVar[bool] = True


def _candidates(
    balance: Balance, servos: Bool[np.ndarray, " row"], common: float | None
) -> Iterable[float]:
    """Factors to try: those of units that servos may be about, then what they come to."""
    yield from (f for f in _UNIT_OF if common is None or abs(common / f - 1.0) < _NAMED)
    yield common or _fitted(balance, servos)


def _finding(balance: Balance, factor: float) -> AuditFinding:
    """That gains of all servos are off by a factor, and what to change in the MJCF."""
    rows = [row for row in balance.rows if row.drive.servo]
    damped = _damped(balance, rows, factor)
    times = f"{factor:.4g}" if factor > 1.0 else f"1/{1.0 / factor:.4g}"
    unit = f"in another unit, {_UNIT_OF[factor]}" if factor in _UNIT_OF else "not the drives'"
    return AuditFinding(
        "gain_unit",
        (),
        tuple(f"actuator {row.drive.name}" for row in rows),
        f"The model's servos are all {times} times as stiff as the drives: their gains are {unit}",
        f"{'kp' if damped else 'kp and kv'} of every servo times {1.0 / factor:.5g} in the MJCF",
        model_change=_times(1.0 / factor, [row.drive for row in rows], damped),
    )


def _about(factor: float, near: float = _NEAR) -> tuple[float, float]:
    return factor * (1.0 - near), factor * (1.0 + near)


def _left(balance: Balance, factor: float, agreed: bool) -> Float[np.ndarray, " row"]:
    """What is left of the forces with a factor of all gains, or of kp alone if servos agree."""
    gains = _about(factor, _WIDE)
    whole = balance.unexplained_forces(gains=gains)
    if not agreed:
        return whole
    return np.minimum(whole, balance.damped(factor).unexplained_forces(gains=gains))


def _impossible(factor: float) -> bool:
    """Tell whether no physics makes a servo look so soft, or so stiff."""
    return not 1.0 / _FAR < factor < _FAR


def _common(balance: Balance, servos: Bool[np.ndarray, " row"]) -> float | None:
    """The factor at which each servo alone arrives, if they agree."""
    each = balance.plain()[servos, 0]
    factor = float(np.median(each))
    near = _WIDE if _impossible(factor) else _NEAR
    agree = factor > 0.0 and np.abs(each / factor - 1.0).max() < near
    return factor if agree and not 1.0 / _USUAL < factor < _USUAL else None


def _fitted(balance: Balance, servos: Bool[np.ndarray, " row"]) -> float:
    """The factor that leaves the least of the forces of all servos."""
    factor = 1.0
    grids: tuple[Float[np.ndarray, " trial"], ...] = (
        np.geomspace(1.0 / _MOST, _MOST, 41),
        np.geomspace(0.7, 1.4, 9),
        np.geomspace(0.95, 1.05, 5),
    )
    for grid in grids:
        left = [
            float(np.log(balance.unexplained_forces(gains=_about(f, _EXACT))[servos] + 1e-6).mean())
            for f in factor * grid
        ]
        factor *= float(grid[int(np.argmin(left))])
    return factor


def _damped(balance: Balance, rows: Sequence[Row], factor: float) -> bool:
    """Tell whether the servos' damping is right as it stands, and their stiffness alone is not.

    Then at each joint as much damping is missing as the factor takes from its servo.
    """
    taken = [abs(row.drive.bias[2]) * row.drive.gear**2 * (factor - 1.0) for row in rows]
    missing = [m for row, m in zip(balance.rows, balance.plain()[:, 1], strict=True) if row in rows]
    return all(taken) and all(
        abs(m / t - 1.0) < _STAYS for m, t in zip(missing, taken, strict=True)
    )


def _times(factor: float, drives: Sequence[Drive], damped: bool) -> Amendment:
    names = {drive.name for drive in drives}

    def change(spec: mujoco.MjSpec) -> None:
        for actuator in spec.actuators:
            if actuator.name in names:
                bias = factor * np.array(actuator.biasprm)
                if damped:
                    bias[2] = actuator.biasprm[2]
                actuator.gainprm = factor * np.array(actuator.gainprm)
                actuator.biasprm = bias

    return change
