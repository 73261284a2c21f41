"""Gains of all servos in another unit: force per degree, or per thousandth of a radian."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import ClassVar

import mujoco
import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.finding import AuditFinding
from wt.physics.scene import Amendment

UNITS = {"degrees for radians": 180.0 / math.pi, "thousandths for wholes": 1000.0}
"""Factors that gains of another unit are off by, either way."""
_NEAR = 0.1  # of such a factor: what friction and a weight may make of it
_DECISIVE = 5.0  # what is left of a servo's force without the factor, over with it
_RIGHT = 0.3  # of a force, that may be left with it
_ALONE = 0.1  # … of every force, where nothing else is wrong
_LEAST = 2  # servos that show it: one drive's gain is physics


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
        given = balance.unexplained_forces()[servos]
        for unit, size in UNITS.items():
            for factor in (size, 1.0 / size):
                near = factor * (1.0 - _NEAR), factor * (1.0 + _NEAR)
                left = balance.unexplained_forces(gains=near)[servos]
                shown = (given > _DECISIVE * left) & (left < _RIGHT)
                if shown.sum() < _LEAST or (left > given).any():
                    continue
                if self.alone and not (left < _ALONE).all():
                    continue
                drives = [row.drive for row in balance.rows if row.drive.servo]
                times = f"{factor:.4g}" if factor > 1.0 else f"1/{1.0 / factor:.4g}"
                yield AuditFinding(
                    "gain_unit",
                    (),
                    tuple(f"actuator {d.name}" for d in drives),
                    f"The model's servos are all {times} times as stiff as the drives: their gains "
                    f"are in another unit, {unit}",
                    f"kp and kv of every servo times {1.0 / factor:.5g} in the MJCF",
                    model_change=_times(1.0 / factor, {d.name for d in drives}),
                )
                return


@register
class GainUnitAlone(GainUnit):
    """The same where it explains every servo: else columns get units that make up for it."""

    stage: ClassVar[Stage] = "gain"
    alone: ClassVar[bool] = True


def _times(factor: float, names: set[str]) -> Amendment:
    def change(spec: mujoco.MjSpec) -> None:
        for actuator in spec.actuators:
            if actuator.name in names:
                actuator.gainprm = factor * np.array(actuator.gainprm)
                actuator.biasprm = factor * np.array(actuator.biasprm)

    return change
