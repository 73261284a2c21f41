"""Held-out recordings, replayed: what an effect gains on them, and how certain that is."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from wt.diagnose.likelihood.adapt import (
    FARTHEST,
    REWEIGHTED,
    hidden,
    initial_states,
    project,
    responses,
)
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.replays import Replays
from wt.diagnose.likelihood.steps import Steps
from wt.diagnose.recordings.smooth import Smoothed
from wt.diagnose.recordings.stretches import BURN_IN_S, stretches_of
from wt.diagnose.residual.signature import elsewhere
from wt.diagnose.selection.ranks import signed_rank
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer

_BLOCK_S, _BLOCKS = (0.25, 1.0), 24
"""Shortest and longest block [s], and how many there should be: errors remember for less."""
_TOUCHED = 1e-3
"""A block whose error changes by less than this share of the largest change is not touched."""
_WHOLE, _SELDOM = 0.99, 0.25
"""What makes up so much of a change in fewer than this share of the blocks shows seldom."""
_ALL_BUT_FEW = 8
"""Ways to be no less extreme, of 2ⁿ signs of n ranks, if the least three may have either sign."""
RAN_AWAY = 1.0
"""Error that a replay counts with after it exploded [rad or m]."""


@dataclass(frozen=True, eq=False)
class Holdout:
    """Held-out recordings, ready to be replayed.

    Attributes:
        smoothed: the recordings.
        stretches: what is replayed open loop.
        measured: positions, (N, nv); NaN where missing, and while hidden states settle.
        block: index of the block of up to a second that each sample belongs to, (N,).
        fine: the same with the shortest blocks.
        forgets: whether stretches are long.
        known: what other initial states change in replays, (N, nv, m), by the added joints of the
            hypothesis: what else is in it is taken not to matter where a base floats.
        steps: those that do for what is different between hypotheses; None where nothing is known.
    """

    smoothed: Smoothed
    stretches: tuple[Stretch, ...]
    measured: Float[np.ndarray, "sample dof"]
    block: Int[np.ndarray, " sample"]
    fine: Int[np.ndarray, " sample"]
    forgets: bool
    known: dict[frozenset[str], Float[np.ndarray, "sample dof change"]] = field(
        default_factory=dict
    )
    steps: Steps | None = None

    @functools.lru_cache(maxsize=4)  # noqa: B019 – lives and dies with a diagnosis
    def replayer(self, step: float) -> Replayer:
        """Its replays at steps of so long [s], which are asked for one effect after another."""
        return Replayer(self.smoothed.motion.scene, self.stretches, step)

    @functools.lru_cache(maxsize=4)  # noqa: B019 – likewise
    def _coarse(self, step: float, steps: Steps) -> Replays:
        """Its replays at steps that do for differences; where a law is stiff, of so long [s]."""
        scene = self.smoothed.motion.scene
        return Replays(scene, self.stretches, step, steps.at_least(step))

    def side_by_side(
        self, hypotheses: Sequence[Hypothesis], step: float
    ) -> Float[np.ndarray, "hypothesis sample dof"]:
        """Positions of replays: of the first, and of others by what is different from it."""
        if self.steps is None or not self.forgets:
            return self.replayer(step).run(hypotheses).q
        replays = self._coarse(step, self.steps)
        replays.around(hypotheses[0], [])
        return replays.run(hypotheses)

    def response(
        self, hypothesis: Hypothesis, replayer: Replayer
    ) -> Float[np.ndarray, "sample dof change"]:
        """Change of replays of a hypothesis by other initial states."""
        if not self.smoothed.motion.scene.free:
            return responses(replayer, hypothesis)
        added = frozenset(hidden(hypothesis, self.stretches[0]))
        if added not in self.known:
            here = hypothesis if added else ()
            self.known[added] = responses(replayer, here)
        return self.known[added]

    def here(self, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis as it shows in these recordings."""
        return elsewhere(self.smoothed.motion, hypothesis)


def prepare_holdout(
    smoothed: Smoothed,
    forgets: bool,
    seconds: float = np.inf,
    window: float | None = None,
    steps: Steps | None = None,
) -> Holdout:
    """Prepare held-out recordings, as :func:`stretches_of` cuts them; see :class:`Holdout`."""
    pairs = stretches_of(smoothed, forgets, seconds, window=window)
    stretches = tuple(s for s, _ in pairs)
    label = np.concatenate([np.full(len(s.t), i) for i, s in enumerate(stretches)])
    block, fine = blocks_of(label, np.concatenate([s.t for s in stretches]))
    measured = np.concatenate([q for _, q in pairs])
    if forgets:
        settling = np.concatenate([s.t < s.t[0] + BURN_IN_S for s in stretches])
        measured[settling] = np.nan
    return Holdout(smoothed, stretches, measured, block, fine, forgets, steps=steps)


def blocks_of(
    label: Int[np.ndarray, " sample"], t: Float[np.ndarray, " sample"]
) -> tuple[Int[np.ndarray, " sample"], Int[np.ndarray, " sample"]]:
    """Index of the block that each sample belongs to, (N,): about as many as wanted, and shortest.

    Args:
        label: what blocks must not reach across, (N,).
        t: time, (N,) [s].
    """
    total = sum(float(np.ptp(t[label == x])) for x in np.unique(label))
    lengths = (float(np.clip(total / _BLOCKS, _BLOCK_S[0], _BLOCK_S[1])), _BLOCK_S[0])
    partitions = []
    for length in lengths:
        pairs = np.stack([label, (t / length).astype(int)], axis=1)
        partitions.append(np.unique(pairs, axis=0, return_inverse=True)[1].ravel())
    return partitions[0], partitions[1]


def errors(
    holdout: Holdout, hypotheses: Sequence[Hypothesis], step: float
) -> Float[np.ndarray, "hypothesis sample dof"]:
    """Open-loop errors, (H, N, nv); NaN where nothing was measured.

    Where a machine remembers how it began, each stretch's initial state, which was estimated and
    not measured, adapts within its uncertainty.
    """
    here = [holdout.here(h) for h in hypotheses]
    replayer = holdout.replayer(step)
    replay_errors = _missed(holdout, replayer.run(here).q)
    if holdout.forgets:
        return replay_errors
    measured = np.isfinite(holdout.measured)
    first = here[:1] if not holdout.smoothed.motion.scene.free else here
    response = [holdout.response(h, replayer) * measured[:, :, None] for h in first]
    response *= len(here) // len(first)
    return np.stack(
        [
            np.where(measured, _begun(holdout, e, r), np.nan)
            for e, r in zip(replay_errors, response, strict=True)
        ]
    )


def _compared(
    holdout: Holdout, hypotheses: Sequence[Hypothesis], step: float
) -> Float[np.ndarray, "hypothesis sample dof"]:
    """Errors as :func:`errors`, of hypotheses that are judged by how they differ.

    As in a search, only the first takes fine steps: of many effects each is left out once.
    """
    if not holdout.forgets:
        return errors(holdout, hypotheses, step)
    here = [holdout.here(h) for h in hypotheses]
    return _missed(holdout, holdout.side_by_side(here, step))


def _missed(
    holdout: Holdout, q: Float[np.ndarray, "hypothesis sample dof"]
) -> Float[np.ndarray, "hypothesis sample dof"]:
    """Errors of replays' positions, those of what exploded as large as they count."""
    return np.where(np.isfinite(q), q, holdout.measured + RAN_AWAY) - holdout.measured


def _begun(
    holdout: Holdout,
    error: Float[np.ndarray, "sample dof"],
    response: Float[np.ndarray, "sample dof change"],
) -> Float[np.ndarray, "sample dof"]:
    """An error (N, nv) once the initial states have adapted."""
    ends = np.cumsum([len(s.t) for s in holdout.stretches])
    rows = [slice(int(e) - len(s.t), int(e)) for e, s in zip(ends, holdout.stretches, strict=True)]
    left = error = np.nan_to_num(error)
    noise = np.nan_to_num(holdout.smoothed.noise, nan=1.0)
    farthest = np.inf if holdout.smoothed.motion.scene.free else FARTHEST
    for _ in range(REWEIGHTED):
        mse = np.maximum(np.mean(left**2, axis=0), noise**2)
        left = project(error, initial_states(rows, response, mse, farthest))
    return left


@dataclass(frozen=True)
class Gain:
    """Gain of one effect on held-out data.

    Attributes:
        share: share of the squared error that it removes.
        p_value: of that being chance; 1 if no joint's error falls by ``thresholds.material``, or
            what falls at one joint, or most of the time, is more than made up for elsewhere.
            Held-out data had no part in the search, so what has to be paid for is the number of
            effects that are tested, not that of all hypotheses.
        potential: largest share that an effect which changes the replays so much could remove.
        in_turn: whether the p-value is of fitted data left out in turn, held-out ones being mute.
        least_p: the smallest p-value that so few blocks as it shows in could give.
    """

    share: float
    p_value: float
    potential: float = 1.0
    in_turn: bool = False
    least_p: float = 0.0

    @property
    def undecided(self) -> bool:
        """True if the data cannot tell: they are mute, or too few of them show the gain.

        Few are blocks of which a rank test is significant only if all, or all but the least, gain.
        """
        few = self.least_p > THRESHOLDS.significant / _ALL_BUT_FEW and self.share > 0.0
        return self.p_value > THRESHOLDS.significant and (few or self.potential < THRESHOLDS.mute)


def gains(
    holdout: Holdout, hypothesis: Hypothesis, without: Sequence[Hypothesis], step: float
) -> list[Gain]:
    """Held-out gain of a hypothesis over each of some lesser ones; p-values pay for all."""
    return gains_of(holdout, _compared(holdout, [hypothesis, *without], step))


def gains_of(
    holdout: Holdout, replay_errors: Float[np.ndarray, "hypothesis sample dof"]
) -> list[Gain]:
    """As :func:`gains`, of the errors (H, N, nv) of a hypothesis and of some lesser ones."""
    full, *lesser = replay_errors
    pairs = [scaled(np.stack([less, full]), holdout.smoothed.noise) for less in lesser]
    each = [gain_of(less, full, (holdout.block, holdout.fine)) for less, full in pairs]
    n = len(each)
    return [
        replace(g, p_value=min(1.0, g.p_value * n), least_p=min(1.0, g.least_p * n)) for g in each
    ]


def gain(holdout: Holdout, hypothesis: Hypothesis, other: Hypothesis, step: float) -> Gain:
    """Held-out gain of one hypothesis over another."""
    (only,) = gains(holdout, hypothesis, [other], step)
    return only


def gains_with_tolerances(
    objective: Objective, holdout: Holdout, sides: Sequence[Assessed], step: float
) -> tuple[Hypothesis, list[Gain]]:
    """The first with its tolerances, and its gains over the others with theirs.

    They are those of the fitted recordings, beside which each was estimated. These know them well
    only where they leave nothing else to explain: each side has them where it errs less by them in
    the held-out ones.
    """
    each = [(s.hypothesis, (*s.hypothesis, *objective.calibration(s))) for s in sides]
    return _best_gains(holdout, each, step)


def lead_with_tolerances(
    objective: Objective, holdout: Holdout, one: Hypothesis, other: Hypothesis, step: float
) -> Gain:
    """Held-out gain of one hypothesis over another, each with tolerances as around itself."""
    each = []
    for hypothesis in (one, other):
        now = objective.reference(hypothesis)
        each.append((hypothesis, (*hypothesis, *objective.calibration(now))))
    _, (lead,) = _best_gains(holdout, each, step)
    return lead


def _best_gains(
    holdout: Holdout, each: Sequence[tuple[Hypothesis, Hypothesis]], step: float
) -> tuple[Hypothesis, list[Gain]]:
    """The first, and its gains over the others: of each the form that errs less."""
    plain, corrected = zip(*each, strict=True)
    both = _compared(holdout, [*plain, *corrected], step)
    pairs = both.reshape(2, len(each), *both.shape[1:]).swapaxes(0, 1)
    left = [np.nansum(scaled(p, holdout.smoothed.noise) ** 2, axis=(1, 2)) for p in pairs]
    better = np.argmin(left, axis=1)
    return each[0][better[0]], gains_of(holdout, pairs[np.arange(len(each)), better])


def scaled(
    replay_errors: Float[np.ndarray, "hypothesis sample dof"], noise: Float[np.ndarray, " dof"]
) -> Float[np.ndarray, "hypothesis sample dof"]:
    """Errors (H, N, nv), joints in units of the least that any hypothesis leaves of them.

    So none drowns another: in units of noise alone, a quiet sensor behind a model that is not
    exact would. And none is favoured: what one leaves at a joint counts as what another does.
    """
    # of a joint that is not measured, none
    count = np.maximum(np.isfinite(replay_errors).sum(axis=1), 1)
    left = np.sqrt(np.nansum(replay_errors**2, axis=1) / count).min(axis=0)
    return np.asarray(replay_errors / np.fmax(left, noise))


def gain_of(
    less: Float[np.ndarray, "sample dof"],
    full: Float[np.ndarray, "sample dof"],
    blocks: tuple[Int[np.ndarray, " sample"], Int[np.ndarray, " sample"]],
) -> Gain:
    """Gain in scaled errors (N, nv), tested over blocks (N,): those wanted, or the shortest."""
    pairs = [(block_sums(less**2, b), block_sums(full**2, b)) for b in blocks]
    for one, other in pairs:
        difference = one - other
        if not np.isfinite(difference).all() or len(difference) < 3 or not difference.any():
            return Gain(0.0, 1.0, 0.0)
        # what shows in few blocks only, such as a stop, is tested with the shortest ones
        if np.sum(np.abs(difference) > _TOUCHED * np.abs(difference).max()) >= _BLOCKS // 2:
            break
    tested = _tested(difference)
    # ranks: a block in which an error ran away counts no more than any other
    p_value = signed_rank(difference[tested])
    change, left = (np.nansum(x**2, axis=0) for x in (less - full, full))
    potential = float(np.max(change / np.maximum(change + left, 1e-30)))
    share, least_p = float(difference.sum() / one.sum()), float(0.5 ** tested.sum())
    before = np.nansum(less**2, axis=0)
    material = ((before - left) >= THRESHOLDS.material * before).any()
    improves = share > 0.0 and material
    return Gain(share, p_value if improves else 1.0, potential, least_p=least_p)


def _tested(difference: Float[np.ndarray, " block"]) -> Bool[np.ndarray, " block"]:
    """The blocks (B,) that a change is tested over, bool: all, or the few that make it up.

    Noise elsewhere would outvote a hit. Size alone decides, so that nothing still has either sign.
    """
    size = np.abs(difference)
    order = np.argsort(-size)
    count = int(np.searchsorted(np.cumsum(size[order]), _WHOLE * size.sum())) + 1
    most = np.zeros(len(size), bool)
    most[order[:count]] = True
    return most if most.mean() < _SELDOM else np.ones(len(size), bool)


def block_sums(
    values: Float[np.ndarray, "sample joint"], block: Int[np.ndarray, " sample"]
) -> Float[np.ndarray, " block"]:
    """Sum of (N, n) values, NaN left out, over each block, (B,)."""
    sums = np.zeros(int(block.max()) + 1)
    np.add.at(sums, block, np.nansum(values, axis=1))
    return sums
