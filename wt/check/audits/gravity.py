"""Gravity that the robot carries itself and the model does not, the reverse, and which way is down.

The share of the weight that the drives carry says whether gravity is compensated, and the direction
that it pulls along how the base stands. A share between is physics and left to the diagnosis; so is
a tilt of a few degrees, which is noted where nothing else explains as much.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.audits.zero import one_zero
from wt.check.balance import Balance
from wt.check.finding import AuditFinding
from wt.check.weight import Weight
from wt.physics.scene import Amendment, Scene

_WHOLE = 0.12  # of the weight: how near to all or nothing a compensation is
_LEFT = 0.2  # … of it that a model leaves to the drives, which compensates it
_FAINT = 1e-6  # m/s²
_EXPLAINED = 0.1  # of every force, that may be left where nothing else is wrong
_DECISIVE = 5.0  # what is left of the forces without it, over with it
_WORSE = 1.25  # times what is left of a drive's forces as given, that says otherwise
_TILT, _MOUNTED = math.radians(4.0), math.radians(20.0)
"""Angles from which a base is noted to be tilted, and from which it is mounted otherwise."""
_NOTE = 0.5
_STRENGTH = (0.8, 1.25)  # of each drive, beside a quarter turn that others may explain, too
_LIKELY = 2.0  # … beside a direction that is noted
_AGREED = 3.0  # variances, that may be left where all drives agree about the direction,
_OVERWHELMING = 25.0  # or by so much it leaves less than anything else
_ALONG = math.cos(math.radians(8.0))


@register
class Carried:
    """The drives carry the weight, and along that direction, as the model says.

    Where nothing else is wrong, before columns are looked at: they would get units, or zeros, that
    make up for a weight.
    """

    kinds: ClassVar[tuple[str, ...]] = ("gravcomp_missing", "gravcomp_extra", "base_orientation")
    stage: ClassVar[Stage] = "gain"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one, after which every force is explained."""
        balance, weight = subject.balance, _weight(subject)
        if balance is None or not _known(balance):
            return
        found = _carried(weight)
        wrong = balance.unexplained_forces().max() > _EXPLAINED
        if not found and wrong and (weight is None or weight.given > _LEFT):
            found = [f for f in _direction(balance, weight) if f.sure and not one_zero(balance)]
        for finding in found:
            if _beside(balance, finding).unexplained_forces().max() < _EXPLAINED:
                yield finding


@register
class Gravity:
    """The weight in the drives' forces is the model's weight."""

    kinds: ClassVar[tuple[str, ...]] = ("gravcomp_missing", "gravcomp_extra", "base_orientation")
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one."""
        balance = subject.balance
        if balance is None or not _known(balance):
            return
        weight = _weight(subject)
        found = _carried(weight)
        yield from found
        if not found and (weight is None or weight.given > _LEFT):
            yield from _direction(balance, weight)


def _beside(balance: Balance, finding: AuditFinding) -> Balance:
    """The same recording beside the model as a finding mends it."""
    assert finding.model_change is not None
    scene = balance.scene
    return Balance(Scene(scene.path, [*scene.amendments, finding.model_change]), balance.signals)


def _agreed(balance: Balance, finding: AuditFinding) -> bool:
    """True if no drive says otherwise: a robot's weight is compensated in all of its joints.

    In one alone, a spring may balance it.
    """
    given, mended = balance.unexplained_forces(), _beside(balance, finding).unexplained_forces()
    return bool((mended <= _WORSE * given).all())


def _direction(balance: Balance, weight: Weight | None) -> Iterable[AuditFinding]:
    """A base that is mounted otherwise, beside the weight that the drives feel."""
    g = np.array(balance.scene.model.opt.gravity)
    return _turned(balance, g, felt=weight is not None)


def _known(balance: Balance) -> bool:
    """Tell whether there is a weight, and forces to compare it with."""
    strength = np.linalg.norm(balance.scene.model.opt.gravity)
    return balance.dynamic and bool(balance.rows) and bool(strength > _FAINT)


def _weight(subject: Subject) -> Weight | None:
    """What the drives carry; None where they feel nothing of it."""
    balance = subject.balance
    return Weight.of(balance) if balance is not None and _known(balance) else None


def _carried(weight: Weight | None) -> list[AuditFinding]:
    """What :func:`_whole` finds, where no drive says otherwise."""
    if weight is None:
        return []
    return [finding for finding in _whole(weight) if _agreed(weight.balance, finding)]


def _whole(weight: Weight) -> Iterable[AuditFinding]:
    """All of the weight where the model has none of it, or the reverse."""
    given, all_of_it, none = weight.left_as_given(), weight.left(1.0), weight.left(0.0)
    share, bodies = weight.share(), _bodies(weight.balance.scene)
    # of a base that is mounted otherwise all of the weight pulls, and little of it as in the model
    if weight.left(share) > _DECISIVE * weight.left(weight.direction()):
        return
    if weight.given > _LEFT and abs(share) < _WHOLE and given > _DECISIVE * none:
        yield AuditFinding(
            "gravcomp_missing",
            (),
            bodies,
            f"The drives carry {_percent(share)} of the weight that the model has: the robot "
            "compensates gravity itself, and the model does not",
            'gravcomp="1" on every body that moves',
            model_change=_compensate,
        )
    elif weight.given < _LEFT and abs(share - 1.0) < _WHOLE and given > _DECISIVE * all_of_it:
        yield AuditFinding(
            "gravcomp_extra",
            (),
            bodies,
            f"The drives carry {_percent(share)} of the weight, and the model compensates it",
            "no gravcomp on the bodies",
            model_change=_weigh,
        )


def _turned(balance: Balance, g: Float[np.ndarray, " 3"], felt: bool) -> Iterable[AuditFinding]:
    """A base that stands, or hangs, otherwise than in the model, where drives feel its weight."""
    weight = Weight.of(balance, turned=True)
    if weight is None:
        return
    snapped = _quarter(weight.direction(), g)
    angle = math.acos(float(np.clip(snapped @ g / np.linalg.norm(g) ** 2, -1, 1)))
    left = weight.left(snapped / np.linalg.norm(g))
    if angle < _TILT or weight.left_as_given() < _DECISIVE * left:
        return
    small, quarter = angle < _MOUNTED, np.count_nonzero(snapped) == 1
    others = _others(weight)
    beaten = others > (_LIKELY if small else _DECISIVE) * left
    agreed = left < _AGREED or quarter or others > _OVERWHELMING * left
    usual = felt and quarter and weight.as_strong(snapped / np.linalg.norm(g), _STRENGTH)
    if not (agreed and beaten) and not usual:
        return
    said = "[" + ", ".join(f"{x:.2g}" for x in snapped) + "]"
    what = (
        "the base is tilted, which wt diagnose measures"
        if small
        else "the base is mounted otherwise"
    )
    yield AuditFinding(
        "base_orientation",
        (),
        ("world",),
        f"The drives carry a weight that pulls along {said} m/s² in the model's frame, "
        f"{math.degrees(angle):.0f}° from the model's gravity: {what}",
        f'the base\'s quat or euler as mounted, or <option gravity="{said[1:-1]}"/>',
        _NOTE if small else 1.0,
        model_change=_pull(snapped),
    )


def _others(weight: Weight) -> float:
    """The least that anything else leaves which pulls at joints: springs, a rope, a load, zeros.

    A direction has to explain more, if it is no quarter turn that drives as strong as the model's
    carry.
    """
    return min(
        weight.left_to_springs(),
        weight.left_to_a_pull(),
        weight.left_to_a_load(),
        weight.left_to_zeros(),
    )


def _quarter(
    direction: Float[np.ndarray, " 3"], g: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Gravity [m/s²] along the axis that it nearly is along: bases are mounted by quarter turns."""
    size, axis = float(np.linalg.norm(g)), int(np.argmax(np.abs(direction)))
    exact = np.zeros(3)
    exact[axis] = math.copysign(size, direction[axis])
    turned = exact @ g < _ALONG * size**2
    return exact if turned and abs(direction[axis]) > _ALONG else size * direction


def _percent(share: float) -> str:
    return f"{100 * max(share, 0.0):.0f} %"


def _bodies(scene: Scene) -> tuple[str, ...]:
    return tuple(f"body {name}" for name in scene.moving)


def _compensate(spec: mujoco.MjSpec) -> None:
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0


def _weigh(spec: mujoco.MjSpec) -> None:
    for body in spec.bodies[1:]:
        body.gravcomp = 0.0


def _pull(gravity: Float[np.ndarray, " 3"]) -> Amendment:
    def change(spec: mujoco.MjSpec) -> None:
        spec.option.gravity = gravity

    return change
