"""The weight in the drives' forces, and what else may pull at joints as another weight does.

Force by force: what the drives gave is fitted by the model's inertia, by its weight along each
axis of the world, and by physics that may be missing at each joint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float

from wt.check.balance import Balance, Row, free_of_forces
from wt.check.fitting import soft_sign, without

_SHOWN = 0.05  # of the variance of what is carried that the weight's share must be
_CLEAR = 4.0  # … and of what is left of it at best
_RIDGE = 1e-6
_BLIND = 1e-3  # of how sharply a pull is felt along the sharpest axis
_OF_DIRECTION = 2  # numbers that a direction has
_GAINS = (0.5, 2.0)  # of a drive, over the model's
_ROUNDS = 8  # of fitting a direction and the gains in turn
_SMALL = 1e-4  # rad or m, and share of a mass: steps of slopes


@dataclass(frozen=True, eq=False)
class _Part:
    """One drive's force and what it may be made of, with all that may adapt taken out of it.

    Attributes:
        row: the drive.
        force: of the drive.
        bare: that the motion takes without weight.
        along: weight on the joint, per strength of the model's gravity along each axis.
        own: weight that the model leaves to the drive.
        place: the position, its square and its cube: what a spring's force is along.
        free: what may adapt.
        scale: variance that is left at best, to weigh the parts.
    """

    row: Row
    force: Float[np.ndarray, " row"]
    bare: Float[np.ndarray, " row"]
    along: Float[np.ndarray, "row 3"]
    own: Float[np.ndarray, " row"]
    place: Float[np.ndarray, "row 3"]
    free: Float[np.ndarray, "row adapting"]
    scale: float = 1.0

    def gain(self, weight: Float[np.ndarray, " row"]) -> float:
        """The drive's gain, over the model's, that fits a weight best."""
        wanted = self.bare + weight
        best = float(wanted @ self.force) / max(float(wanted @ wanted), 1e-18)
        return float(np.clip(best, *_GAINS))

    def carried(self, weight: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
        """What the force holds beside inertia, by the gain that fits a weight best."""
        return np.asarray(self.force - self.gain(weight) * self.bare)

    def rest(self, weight: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
        """What is left of the force beside a weight, in deviations."""
        left = self.force - self.gain(weight) * (self.bare + weight)
        return np.asarray(left / np.sqrt(self.scale))


@dataclass(frozen=True, eq=False)
class Weight:
    """What the drives carry.

    Attributes:
        balance: of the recording.
        parts: drives that feel the weight.
        gravity: direction of the model's, as a unit vector.
        given: share of the weight that the model leaves to all of them; 1 where none is felt.
    """

    balance: Balance
    parts: tuple[_Part, ...]
    gravity: Float[np.ndarray, " 3"]
    given: float

    @classmethod
    def of(cls, balance: Balance, turned: bool = False) -> Weight | None:
        """Fit it; None where no drive feels a weight that changes.

        Args:
            balance: of the recording.
            turned: whether the weight may pull along another direction than in the model.
        """
        gravity = np.array(balance.scene.model.opt.gravity)
        down = gravity / np.linalg.norm(gravity)
        every = list(_parts(balance))
        felt = [float(np.sum((p.along @ down) ** 2)) for p in every]
        left_to = sum(float((p.along @ down) @ p.own) for p in every)
        given = left_to / sum(felt) if sum(felt) > 0.0 else 1.0
        shown = []
        for part in every:
            best = _best(part)
            weight = part.along @ (best if turned else down)
            part = _scaled(part, part.along @ best)
            power, carried = float(weight @ weight), part.carried(part.along @ best)
            clear = power / len(weight) > _CLEAR * part.scale
            if clear and power > _SHOWN * float(carried @ carried):
                shown.append(part)
        return cls(balance, tuple(shown), down, given) if shown else None

    def left_as_given(self) -> float:
        """Mean square, in variances, that is left with the weight as the model has it."""
        return _mean([p.rest(p.own) for p in self.parts])

    def left(self, pull: Float[np.ndarray, "*axis"] | float) -> float:
        """The same with a share of the weight, or with another pull than the model's."""
        vector = self.gravity * pull if np.ndim(pull) == 0 else np.asarray(pull)
        return _mean([p.rest(p.along @ vector) for p in self.parts])

    def as_strong(self, pull: Float[np.ndarray, " 3"], gains: tuple[float, float]) -> bool:
        """Tell whether each drive's gain, over the model's, is between two beside a pull."""
        each = [p.gain(p.along @ pull) for p in self.parts]
        return gains[0] < min(each) and max(each) < gains[1]

    def left_to_springs(self) -> float:
        """The same with springs, linear or not, at the joints where they help most.

        At as many as a direction has numbers: a tilt must say more than as little else would.
        """
        stiff = np.array([np.mean(p.rest(p.own) ** 2) for p in self.parts])
        sprung = np.array([np.mean(without(p.rest(p.own), p.place) ** 2) for p in self.parts])
        helped = np.argsort(sprung - stiff)[:_OF_DIRECTION]
        stiff[helped] = sprung[helped]
        return float(stiff.mean())

    def left_to_a_pull(self) -> float:
        """The same with a constant force on the body where one helps most, if there are several.

        On one body alone, it is as good as a tilt.
        """
        moving = self.balance.scene.moving
        if len(moving) < 2:
            return np.inf
        motion = self.balance.signals.motion(self.balance.scene)
        return min(self._left_to(motion.point(body).jacobian) for body in moving)

    def left_to_a_load(self) -> float:
        """The same with another mass, and centre of it, of the body where that helps most."""
        scene = self.balance.scene
        bodies = [scene.model.body(name).id for name in scene.moving]
        return min((self._left_to(self._loads(body)) for body in bodies), default=np.inf)

    def left_to_zeros(self) -> float:
        """The same with other zeros of the encoders of the two joints where that helps most."""
        s, steps = self.balance.signals, []
        for i in range(s.q.shape[1]):
            q = s.q.copy()
            q[:, i] += _SMALL
            steps.append((self.balance.inverse(q, s.v, s.a) - self._demand) / _SMALL)
        table = np.stack(steps, axis=1)
        first = int(np.argmin([self._left_to(table[:, [i]]) for i in range(table.shape[1])]))
        return min(self._left_to(table[:, [first, i]]) for i in range(table.shape[1]))

    def share(self) -> float:
        """Share of the weight that the drives carry."""
        share = 1.0
        for _ in range(_ROUNDS):
            ((share,), _) = self._fitted(share * self.gravity, self.gravity[:, None])
        return float(share)

    def direction(self) -> Float[np.ndarray, " 3"]:
        """Direction of a pull as strong as the model's gravity that leaves least, a unit vector."""
        starts = [self.gravity, *np.vstack([np.eye(3), -np.eye(3)])]
        return min((self._turned(start) for start in starts), key=self.left)

    def _turned(self, pull: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
        """A direction that leaves less than another one: it and the drives' gains in turn."""
        for _ in range(_ROUNDS):
            fitted, gram = self._fitted(pull, np.eye(3))
            # what no drive feels, a pull along an axle of all of them, is known by its strength
            pull = _as_strong(pull, fitted, gram)
        return pull

    def _fitted(
        self, pull: Float[np.ndarray, " 3"], axes: Float[np.ndarray, "3 axis"]
    ) -> tuple[Float[np.ndarray, " axis"], Float[np.ndarray, "axis axis"]]:
        """What fits best along some axes by the gains beside a pull, and how sharply."""
        gains = [p.gain(p.along @ pull) for p in self.parts]
        both = [(p, g, np.sqrt(p.scale)) for p, g in zip(self.parts, gains, strict=True)]
        x = np.concatenate([g * p.along @ axes / size for p, g, size in both])
        y = np.concatenate([(p.force - g * p.bare) / size for p, g, size in both])
        gram, start = x.T @ x, axes.T @ pull
        held = gram + _RIDGE * np.trace(gram) * np.eye(len(gram))
        return start + np.linalg.solve(held, x.T @ (y - x @ start)), gram

    @property
    def _demand(self) -> Float[np.ndarray, "row dof"]:
        s = self.balance.signals
        return self.balance.inverse(s.q, s.v, s.a)

    def _loads(self, body: int) -> Float[np.ndarray, "row load=4 dof"]:
        """Force on every joint per point mass at a body's origin and along its axes."""
        s, model, steps = self.balance.signals, self.balance.scene.model, []
        for point in np.vstack([np.zeros(3), np.eye(3)]):
            loaded = mujoco.MjModel.__copy__(model)
            mass = float(model.body_mass[body])
            more = _SMALL * max(mass, float(model.body_mass.mean()))
            middle = (mass * model.body_ipos[body] + more * point) / (mass + more)
            loaded.body_ipos[body], loaded.body_mass[body] = middle, mass + more
            steps.append((demanded(free_of_forces(loaded), s.q, s.v, s.a) - self._demand) / more)
        return np.stack(steps, axis=1)

    def _left_to(self, columns: Float[np.ndarray, "row cause dof"]) -> float:
        """What is left as given beside causes that act on all joints together."""
        rest = [p.rest(p.own) for p in self.parts]
        each = [
            without(columns[:, :, p.row.drive.dof], p.free) / np.sqrt(p.scale) for p in self.parts
        ]
        x, y = np.concatenate(each), np.concatenate(rest)
        size = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
        y = y - (x / size) @ np.linalg.lstsq(x / size, y)[0]
        return float(y @ y) / len(y)


def _as_strong(
    before: Float[np.ndarray, " 3"],
    pull: Float[np.ndarray, " 3"],
    gram: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, " 3"]:
    """A unit vector that is like a pull where drives feel it; otherwise on the side of another."""
    felt, axes = np.linalg.eigh(gram)
    along = axes.T @ pull
    blind = felt < _BLIND * felt.max()
    if not blind.any():
        return np.asarray(pull / np.linalg.norm(pull))
    seen = float(np.linalg.norm(along[~blind]))
    side = axes[:, blind] @ (axes[:, blind].T @ before)
    if seen >= 1.0 or not np.linalg.norm(side) > 0.0:
        side = np.zeros(3)
    else:
        side *= math.sqrt(1.0 - seen**2) / np.linalg.norm(side)
    turned = axes[:, ~blind] @ along[~blind] + side
    return np.asarray(turned / np.linalg.norm(turned))


def _mean(rests: Sequence[Float[np.ndarray, " row"]]) -> float:
    return float(np.mean([np.mean(rest**2) for rest in rests]))


def _best(part: _Part) -> Float[np.ndarray, " 3"]:
    """The pull that fits one drive best by itself, whatever its gain."""
    columns = np.column_stack([part.bare, part.along])
    gain, *pull = np.linalg.lstsq(columns, part.force, rcond=1e-8)[0]
    if not _GAINS[0] <= gain <= _GAINS[1]:
        gain = float(np.clip(gain, *_GAINS))
        pull = np.linalg.lstsq(part.along, part.force - gain * part.bare, rcond=1e-8)[0]
    return np.asarray(pull) / gain


def _scaled(part: _Part, weight: Float[np.ndarray, " row"]) -> _Part:
    """A part with the variance that its best weight leaves."""
    left = float(np.mean((part.force - part.gain(weight) * (part.bare + weight)) ** 2))
    return replace(part, scale=max(left, 1e-9 * float(np.mean(part.force**2)), 1e-18))


def _parts(balance: Balance) -> Iterator[_Part]:
    """Every drive's force, and what it may be made of."""
    s, m = balance.signals, balance.scene.model
    demand = balance.inverse(s.q, s.v, s.a)
    bare, axes = _weights(m, s.q, s.v, s.a, float(np.linalg.norm(m.opt.gravity)))
    for row in balance.rows:
        drive, i = row.drive, row.drive.dof
        u = np.clip(s.u[:, drive.index], *drive.commands)
        held = drive.bias[1] * s.q[:, i] + drive.bias[2] * s.v[:, i]
        speed, late = s.v[:, i], row.scale * s.du[:, drive.index]
        free = np.stack([np.ones(len(u)), soft_sign(speed), speed, s.a[:, i], late], axis=1)
        yield _Part(
            row,
            without(row.scale * u + drive.gear**2 * held, free),
            without(bare[:, i], free),
            without(axes[:, i], free),
            without(demand[:, i] - bare[:, i], free),
            without(s.q[:, i, None] ** np.arange(1, 4), free),
            free,
        )


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
    forces = []
    for pull in (np.zeros(3), *(strength * np.eye(3))):
        m.opt.gravity[:] = pull
        forces.append(demanded(m, q, v, a))
    bare, *along = forces
    return bare, np.stack([x - bare for x in along], axis=2)


def demanded(
    model: mujoco.MjModel,
    q: Float[np.ndarray, "row dof"],
    v: Float[np.ndarray, "row dof"],
    a: Float[np.ndarray, "row dof"],
) -> Float[np.ndarray, "row dof"]:
    """Force that a model demands for a motion."""
    d, forces = mujoco.MjData(model), np.zeros_like(q)
    for k in range(len(q)):
        d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, d)
        forces[k] = d.qfrc_inverse
    return forces
