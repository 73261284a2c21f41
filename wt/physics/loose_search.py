"""Search for the law that a moving load follows, by a force residual.

Paths under many laws cost little more than one (:mod:`wt.physics.loose`), and the force of each is
linear in mass and first moments. So laws are tried side by side, and the best ones varied, until
none of the variants explains more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from wt.physics.inertia import reach
from wt.physics.loose import Centre, LooseLaw, Path, paths, wrenches
from wt.physics.motion import Motion

_BLOCK_S = 0.04
"""Forces are averaged over so much: accelerations are noisy, and impacts short."""
_LEAST, _NEARLY = 0.1, 0.8
"""A fixed load must explain this share of the residual, and this share of what the best place
explains: wherever a load moves, there is weight."""
_MOVED = 0.93
"""Largest share that a load that moves may leave of what a fixed one leaves."""
_TRAVELS = (0.02, 0.05, 0.1, 0.2)  # m
_ROLLING = 0.4
_ROUNDS = (1.5, 1.5, 1.4, 1.25, 1.15)
"""Factors by which the best laws are varied, round after round."""
_VARIED, _GIVEN, _FURTHEST = 3, 2, 1.5
_PIECE_S = 10.0
"""Longer segments are looked at in pieces of about so long [s], side by side."""
_LIKELIEST = 8  # of the coarse laws: where forces are noisy the best is among the first ten or so


@dataclass(frozen=True, eq=False)
class _Fit:
    """A law with the mass and place that explain most.

    Attributes:
        law: it.
        centre: middle of its travel that its path was computed with.
        there: middle that explains most, the path staying as it is.
        mass: [kg].
        left: mean square that it leaves, by what a fixed load leaves of each joint.
        score: half the log of the mean square left, summed over joints and blocks.
    """

    law: LooseLaw | None
    centre: Centre
    there: Centre
    mass: float
    left: float
    score: float


def laws_that_fit(motion: Motion, body: str) -> list[tuple[LooseLaw, Centre, float]]:
    """The best laws of a load in a body, its middle and its mass [kg]; best first, if any."""
    if body not in _places(motion):
        return []
    search = _Search(motion, body)
    # what moves may mislead as to where its middle is
    starts = (search.middle, search.origin)
    best = _distinct(search.tried([(law, at) for at in starts for law in _coarse()]))[:_VARIED]
    for factor in _ROUNDS:
        laws = {law for fit in best if fit.law for law in _variants(fit.law, factor)}
        loads = [(law, best[0].centre) for law in sorted(laws, key=str)]
        # a path depends on where the centre is, which is better known now, or not
        loads += [(fit.law, fit.there) for fit in best if fit.law]
        best = _distinct([*best, *search.tried(loads)])[:_VARIED]
    return [
        (fit.law, fit.centre, fit.mass) for fit in best[:_GIVEN] if fit.law and fit.left < _MOVED
    ]


def likeliest_laws(motion: Motion, body: str, centre: Centre) -> list[LooseLaw]:
    """Laws of a load around a place known from elsewhere, best first, little as they explain."""
    fits = _distinct(_Search(motion, body).tried([(law, centre) for law in _coarse()]))
    return [fit.law for fit in fits[:_LIKELIEST] if fit.law]


def _distinct(fits: Sequence[_Fit]) -> list[_Fit]:
    """Best first, each law once."""
    by_law: dict[LooseLaw | None, _Fit] = {}
    for fit in sorted(fits, key=lambda f: f.score):
        by_law.setdefault(fit.law, fit)
    return list(by_law.values())


def _coarse() -> list[LooseLaw]:
    laws = []
    for travel in _TRAVELS:
        for breadth in (0.5, 1.0):
            laws.append(LooseLaw((travel, breadth * travel, 0.0), 2.0, 0.0, _ROLLING))
            laws.append(LooseLaw((breadth * travel, travel, 0.0), 2.0, 0.0, _ROLLING))
        for axis in np.eye(3):
            x, y, z = (float(travel * share) for share in axis)
            laws.append(LooseLaw((x, y, z), 4.0, 0.0, 0.0))
        laws += [LooseLaw((travel, travel, 0.0), 0.3 * w, w**2, 0.0) for w in (5.0, 7.0, 9.5)]
    return list(dict.fromkeys(laws))


def _variants(law: LooseLaw, factor: float) -> list[LooseLaw]:
    """Laws that differ from one in one respect."""
    laws = []
    longest = max(law.travel)
    for axis, travel in enumerate(law.travel):
        others = (travel * factor, travel / factor, 0.0) if travel else (0.6 * longest,)
        for other in others:
            changed = list(law.travel)
            changed[axis] = other
            if any(changed):
                laws.append(replace(law, travel=(changed[0], changed[1], changed[2])))
    laws += [replace(law, damping=law.damping * f) for f in (factor, 1.0 / factor)]
    springs = (law.spring * factor, law.spring / factor, 0.0) if law.spring else (25.0, 64.0)
    laws += [replace(law, spring=spring) for spring in springs]
    return [*laws, replace(law, rolling=_ROLLING - law.rolling)]


@lru_cache(maxsize=8)
def _places(motion: Motion) -> frozenset[str]:
    """Bodies in which a load that is fixed would explain much of the residual."""
    gains = {body: _Search(motion, body).fixed_gain for body in motion.scene.moving}
    best = max(gains.values(), default=0.0)
    return frozenset(b for b, gain in gains.items() if gain > max(_LEAST, _NEARLY * best))


class _Search:
    """Fits loads of given laws to a residual.

    Attributes:
        origin: the body's centre of mass.
        middle: where the load would be if it did not move.
        fixed_gain: share of the residual that it would explain then.
    """

    def __init__(self, motion: Motion, body: str) -> None:
        self._motion, self._body = motion, body
        self._blocks = _blocks(motion)
        self._free = motion.touching.free(reach(motion.recorded, body))
        self._residual = self._mean(motion.unexplained)
        self._scale = np.std(self._residual, axis=0) + 1e-12
        centre = motion.scene.model.body(body).ipos
        still = Path(*np.zeros((3, len(motion), 3)))
        x, y, z = (float(c) for c in centre)
        before = float(np.sum((self._residual / self._scale) ** 2))
        self.origin = (x, y, z)
        fixed, left = self._fitted(None, self.origin, still)
        self.fixed_gain = 1.0 - float(np.sum((left / self._scale) ** 2)) / before
        self.middle = fixed.there
        # from here on a joint counts by what a fixed load leaves of it
        self._scale = np.sqrt(np.mean(left**2, axis=0)) + 1e-12

    def tried(self, loads: Sequence[tuple[LooseLaw, Centre]]) -> list[_Fit]:
        """Fits of loads; integrating many side by side costs little more than one."""
        load_paths = paths(self._motion, self._body, loads, _PIECE_S)
        return [self._fitted(*load, path)[0] for load, path in zip(loads, load_paths, strict=True)]

    def _fitted(
        self, law: LooseLaw | None, centre: Centre, path: Path
    ) -> tuple[_Fit, Float[np.ndarray, "block dof"]]:
        """The best load on a path, and what it leaves of the residual, (B, nv)."""
        design = self._mean(self._free @ wrenches(self._motion, self._body, centre, path))
        flat = (design / self._scale[:, None]).reshape(-1, 4)
        size = np.linalg.norm(flat, axis=0) + 1e-12
        x, *_ = np.linalg.lstsq(flat / size, (self._residual / self._scale).reshape(-1), rcond=1e-6)
        x = x / size
        left = self._residual - design @ x
        away = x[1:] / max(x[0], 1e-9)
        if x[0] <= 0.0 or np.linalg.norm(away) > _FURTHEST:
            away = np.zeros(3)
        score = 0.5 * len(left) * float(np.log(np.mean(left**2, axis=0) + 1e-24).sum())
        cx, cy, cz = (float(c) for c in np.array(centre) + away)
        share = float(np.mean((left / self._scale) ** 2))
        return _Fit(
            law, centre, (cx, cy, cz), float(x[0]), share, score if x[0] > 0.0 else np.inf
        ), left

    def _mean(
        self, signal: Float[np.ndarray, " sample *rest"]
    ) -> Float[np.ndarray, " block *rest"]:
        """Means over blocks: (T, …) → (B, …)."""
        sums = np.add.reduceat(signal, self._blocks[:-1], axis=0)
        count = np.diff(self._blocks).reshape(-1, *[1] * (signal.ndim - 1))
        return np.asarray(sums / count)


def _blocks(motion: Motion) -> Int[np.ndarray, " edge"]:
    """First sample of each block, and the end of the last."""
    starts = [
        np.arange(s.rows.start, s.rows.stop, max(1, round(_BLOCK_S / s.dt)))
        for s in motion.segments
    ]
    return np.concatenate([*starts, [len(motion)]])
