"""Gravity that the robot carries itself and the model does not, the reverse, and which way is down.

Force by force: what the drives gave is fitted by the model's inertia, by its weight along each
axis of the world, and by physics that may be missing at each joint. The weight's share then says
whether gravity is compensated, and its direction how the base stands. A share between, or a tilt
of a few degrees, is physics and left to the diagnosis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance, free_of_forces, soft_sign, without
from wt.check.finding import AuditFinding
from wt.physics.scene import Amendment, Scene

_WHOLE = 0.12  # of the weight: how near to all or nothing a compensation is
_DECISIVE = 5.0  # what is left of the forces without it, over with it
_SHOWN = 0.05  # of the force's variance that the weight's share must be
_TILT = math.radians(30.0)
_ALONG = math.cos(math.radians(8.0))
_STRENGTH = (0.8, 1.25)  # of gravity, that the fitted one may have
_RIDGE = 1e-6
_OF_DIRECTION = 2  # numbers that a direction has


@register
class Gravity:
    """The weight in the drives' forces is the model's weight."""

    kinds: ClassVar[tuple[str, ...]] = ("gravcomp_missing", "gravcomp_extra", "base_orientation")
    stage: ClassVar[Stage] = "rest"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one."""
        balance = subject.balance
        if balance is None or not balance.dynamic or not balance.rows:
            return
        g = np.array(balance.scene.model.opt.gravity)
        if np.linalg.norm(g) < 1e-6:
            return
        weight = _Weight.of(balance)
        if weight is None:
            return
        given, all_of_it, none = weight.left_as_given(), weight.left(1.0), weight.left(0.0)
        share = weight.share()
        compensated = weight.given < 0.2
        if not compensated and abs(share) < _WHOLE and given > _DECISIVE * none:
            bodies = _bodies(balance.scene)
            yield AuditFinding(
                "gravcomp_missing",
                (),
                bodies,
                f"The drives carry {_percent(share)} of the weight that the model has: the robot "
                "compensates gravity itself, and the model does not",
                'gravcomp="1" on every body that moves',
                model_change=_compensate,
            )
        elif compensated and abs(share - 1.0) < _WHOLE and given > _DECISIVE * all_of_it:
            yield AuditFinding(
                "gravcomp_extra",
                (),
                _bodies(balance.scene),
                f"The drives carry {_percent(share)} of the weight, and the model compensates it",
                "no gravcomp on the bodies",
                model_change=_weigh,
            )
        elif not compensated:
            yield from _turned(balance, weight, g, given)


def _turned(
    balance: Balance, weight: _Weight, g: Float[np.ndarray, " 3"], given: float
) -> Iterable[AuditFinding]:
    """A base that stands, or hangs, otherwise than in the model."""
    snapped = _quarter(weight.direction(g), g)
    size = float(np.linalg.norm(snapped) / np.linalg.norm(g))
    angle = math.acos(
        float(np.clip(snapped @ g / np.linalg.norm(snapped) / np.linalg.norm(g), -1, 1))
    )
    if angle < _TILT or not _STRENGTH[0] < size < _STRENGTH[1]:
        return
    beaten = _DECISIVE * weight.left(snapped / np.linalg.norm(g))
    quarter = np.count_nonzero(snapped) == 1
    if given < beaten or not (
        quarter or (weight.left_to_springs() > beaten and weight.left_to_a_pull(balance) > beaten)
    ):
        return
    said = "[" + ", ".join(f"{x:.2g}" for x in snapped) + "]"
    yield AuditFinding(
        "base_orientation",
        (),
        ("world",),
        f"The drives carry a weight that pulls along {said} m/s² in the model's frame, "
        f"{math.degrees(angle):.0f}° from the model's gravity: the base is mounted otherwise",
        f'the base\'s quat or euler as mounted, or <option gravity="{said[1:-1]}"/>',
        model_change=_pull(snapped),
    )


def _quarter(
    direction: Float[np.ndarray, " 3"], g: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Gravity along the axis that it nearly is along: bases are mounted by quarter turns."""
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) < _ALONG * np.linalg.norm(direction):
        return direction
    exact = np.zeros(3)
    exact[axis] = np.copysign(np.linalg.norm(g), direction[axis])
    return exact


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


@dataclass(frozen=True, eq=False)
class _Weight:
    """Forces of the drives, with all that may adapt already taken out of them.

    Attributes:
        force: of each row's drive, less the model's inertia.
        along: weight on each row's joint, per strength of the model's gravity along each axis.
        gravity: direction of the model's, as a unit vector.
        own: weight that the model leaves to each row's drive.
        place: each row's position, its square and its cube: what a spring's force is along.
        free: what may adapt in each row.
        dofs: each row's joint.
        given: share of the weight that it leaves to all of them.
        scale: variance that is left of each row's force at the best, to weigh the rows.
    """

    force: tuple[Float[np.ndarray, " row"], ...]
    along: tuple[Float[np.ndarray, "row 3"], ...]
    gravity: Float[np.ndarray, " 3"]
    own: tuple[Float[np.ndarray, " row"], ...]
    place: tuple[Float[np.ndarray, "row 3"], ...]
    free: tuple[Float[np.ndarray, "row adapting"], ...]
    dofs: tuple[int, ...]
    given: float
    scale: Float[np.ndarray, " drive"]

    @classmethod
    def of(cls, balance: Balance) -> _Weight | None:
        """Fit it; None where no joint feels a weight that changes."""
        s, m = balance.signals, balance.scene.model
        strength = float(np.linalg.norm(m.opt.gravity))
        demand = balance.inverse(s.q, s.v, s.a)
        bare, axes = _weights(m, s.q, s.v, s.a, strength)
        down = np.array(m.opt.gravity) / strength
        force, along, place, adapting, scale, shown = [], [], [], [], [], []
        left_to, own = [], np.zeros(2)
        for row in balance.rows:
            drive, i = row.drive, row.drive.dof
            u = np.clip(s.u[:, drive.index], *drive.commands)
            pull = row.scale * u + drive.gear**2 * (
                drive.bias[1] * s.q[:, i] + drive.bias[2] * s.v[:, i]
            )
            speed = s.v[:, i]
            free = np.stack(
                [
                    np.ones_like(speed),
                    soft_sign(speed),
                    speed,
                    s.a[:, i],
                    row.scale * s.du[:, drive.index],
                ],
                axis=1,
            )
            y, x = without(pull - bare[:, i], free), without(axes[:, i], free)
            w = x @ down
            left_to.append(without(demand[:, i] - bare[:, i], free))
            own += [w @ left_to[-1], w @ w]
            best = np.linalg.lstsq(x, y, rcond=1e-8)[0]
            force.append(y)
            along.append(x)
            place.append(without(s.q[:, i, None] ** np.arange(1, 4), free))
            adapting.append(free)
            scale.append(max(float(np.mean((y - x @ best) ** 2)), 1e-9 * float(np.mean(pull**2))))
            shown.append(
                float(w @ w) > _SHOWN * float(y @ y) and float(w @ w) / len(w) > 4 * scale[-1]
            )
        if not any(shown) or own[1] == 0.0:
            return None
        chosen = np.flatnonzero(shown)
        return cls(
            tuple(force[k] for k in chosen),
            tuple(along[k] for k in chosen),
            down,
            tuple(left_to[k] for k in chosen),
            tuple(place[k] for k in chosen),
            tuple(adapting[k] for k in chosen),
            tuple(balance.rows[k].drive.dof for k in chosen),
            float(own[0] / own[1]),
            np.array(scale)[chosen],
        )

    def left_as_given(self) -> float:
        """Weighted mean square that is left with the weight as the model has it."""
        pairs = zip(self.force, self.own, self.scale, strict=True)
        return float(np.mean([np.mean((y - w) ** 2) / s for y, w, s in pairs]))

    def left_to_springs(self) -> float:
        """The same with springs, linear or not, at the joints where they help most.

        At as many as a direction has numbers: a tilt must say more than as little else would.
        """
        rows = list(zip(self.force, self.own, self.place, self.scale, strict=True))
        stiff = np.array([np.mean((y - w) ** 2) / s for y, w, _, s in rows])
        sprung = np.array([np.mean(without(y - w, place) ** 2) / s for y, w, place, s in rows])
        helped = np.argsort(sprung - stiff)[:_OF_DIRECTION]
        stiff[helped] = sprung[helped]
        return float(stiff.mean())

    def left_to_a_pull(self, balance: Balance) -> float:
        """The same with a constant force on the body where one helps most, if there are several.

        On one body alone, it is as good as a tilt.
        """
        scene, rows = balance.scene, range(len(self.force))
        if len(scene.moving) < 2:
            return np.inf
        size = [np.sqrt(len(y) * s) for y, s in zip(self.force, self.scale, strict=True)]
        lacking = np.concatenate([(self.force[k] - self.own[k]) / size[k] for k in rows])
        motion, left = balance.signals.motion(scene), []
        for body in scene.moving:
            pull = motion.point(body).jacobian
            each = [without(pull[:, :, self.dofs[k]], self.free[k]) / size[k] for k in rows]
            columns = np.concatenate(each)
            rest = lacking - columns @ np.linalg.lstsq(columns, lacking)[0]
            left.append(float(rest @ rest) / len(rows))
        return min(left)

    def left(self, pull: Float[np.ndarray, "*axis"] | float) -> float:
        """Weighted mean square that is left with a share of the weight, or with another pull."""
        vector = self.gravity * pull if np.ndim(pull) == 0 else np.asarray(pull)
        squares = [
            np.mean((y - x @ vector) ** 2) / s
            for y, x, s in zip(self.force, self.along, self.scale, strict=True)
        ]
        return float(np.mean(squares))

    def share(self) -> float:
        """Share of the weight that the drives carry."""
        w = [x @ self.gravity for x in self.along]
        above = sum(a @ y / s for a, y, s in zip(w, self.force, self.scale, strict=True))
        below = sum(a @ a / s for a, s in zip(w, self.scale, strict=True))
        return float(above / below)

    def direction(self, g: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
        """Gravity that fits best [m/s²]; the model's where nothing says."""
        gram = sum(x.T @ x / s for x, s in zip(self.along, self.scale, strict=True))
        right = sum(
            x.T @ (y - x @ self.gravity) / s
            for x, y, s in zip(self.along, self.force, self.scale, strict=True)
        )
        gram = gram + _RIDGE * np.trace(gram) * np.eye(3)
        return np.asarray(g + np.linalg.solve(gram, right) * np.linalg.norm(g))


def _weights(
    model: mujoco.MjModel,
    q: Float[np.ndarray, "row dof"],
    v: Float[np.ndarray, "row dof"],
    a: Float[np.ndarray, "row dof"],
    strength: float,
) -> tuple[Float[np.ndarray, "row dof"], Float[np.ndarray, "row dof axis=3"]]:
    """Force that a motion demands without gravity, and the weight along each axis on top of it."""
    m = free_of_forces(model)
    m.body_gravcomp[:] = 0.0
    d = mujoco.MjData(m)
    pulls = [np.zeros(3), *(strength * np.eye(3))]
    result: list[Sequence[Float[np.ndarray, " dof"]]] = []
    for k in range(len(q)):
        forces = []
        for pull in pulls:
            m.opt.gravity[:] = pull
            d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]
            mujoco.mj_inverse(m, d)
            forces.append(d.qfrc_inverse.copy())
        result.append(forces)
    table = np.array(result).reshape(len(q), 4, -1)
    return table[:, 0], np.moveaxis(table[:, 1:] - table[:, :1], 1, 2)
