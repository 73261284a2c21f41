"""How far an experiment is expected to tell hypotheses apart, before it is run.

Two machines that recordings leave move differently under the same commands. Of that difference r
only so much counts as neither of them can explain by other parameters within their intervals, nor
by the model's tolerances: with the sensitivities A of the motion to all of these, one deviation
large, and the noise Σ of measured positions, the expected log-likelihood ratio is
½ rᵀ(Σ + A Aᵀ)⁻¹ r (A. C. Atkinson and V. V. Fedorov, Biometrika 62, 1975; linear around each, as in
G. E. P. Box and W. J. Hill, Technometrics 9, 1967).

What it would tell of the parameters of what is claimed is the gain in information,
½ log det(I + Sᵀ Jᵀ(Σ + T Tᵀ)⁻¹ J S), with the tolerances T as nuisance and the deviations S so
far.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from wt.ask.alive import Alive
from wt.diagnose.likelihood.tolerances import alike, tolerances
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.planted import Hypothesis
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene

_SHARE = 0.5
"""Of a parameter's deviation, over which its sensitivity is taken."""


@dataclass(frozen=True, eq=False)
class Expected:
    """What an experiment is expected to tell.

    Attributes:
        apart: for each pair of hypotheses, log-likelihood by which the true one leads [nats].
        information: gain in what is known of the claimed parameters [nats].
    """

    apart: Float[np.ndarray, "alive alive"]
    information: float

    @property
    def most(self) -> float:
        """Lead of the pair that it tells best; zero if there is but one hypothesis."""
        return float(self.apart.max(initial=0.0))

    @property
    def least(self) -> float:
        """Lead of the pair that it tells worst."""
        pairs = self.apart[np.triu_indices(len(self.apart), 1)]
        return float(pairs.min()) if len(pairs) else 0.0


class Separation:
    """Judges experiments by all hypotheses."""

    def __init__(
        self,
        scene: Scene,
        hypotheses: Sequence[Alive],
        noise: Float[np.ndarray, " dof"],
        step: float,
    ) -> None:
        """Prepare.

        Args:
            scene: the machine.
            hypotheses: that the recordings leave, the claimed one first.
            noise: error of a replay that leaves nothing to explain; NaN for joints that are not
                measured.
            step: physics step of replays [s].
        """
        self._scene, self._alive, self._step = scene, tuple(hypotheses), step
        self._measured = np.flatnonzero(np.isfinite(noise))
        self._noise = noise[self._measured]
        claimed = hypotheses[0].hypothesis
        free = tolerances(scene)
        told = alike(free, claimed)
        self._tolerances = [t for t, own in zip(free, told, strict=True) if not own]

    def motions(self, stretches: Sequence[Stretch]) -> list[Float[np.ndarray, "alive sample dof"]]:
        """Joint positions that each hypothesis expects in each experiment [rad or m]."""
        if not stretches:
            return []
        replays = Replayer(self._scene, stretches, self._step)
        q = replays.run([a.hypothesis for a in self._alive]).q
        ends = np.cumsum([len(s.t) for s in stretches])[:-1]
        return np.split(q, ends, axis=1)

    def expected(self, stretches: Sequence[Stretch], begins: Sequence[int]) -> list[Expected]:
        """What each of some experiments would tell.

        Args:
            stretches: the experiments.
            begins: for each, the first sample that counts.
        """
        moved, owners, sizes = self._neighbours()
        replays = Replayer(self._scene, stretches, self._step)
        q = replays.run([*(a.hypothesis for a in self._alive), *moved]).q[..., self._measured]
        ends = np.cumsum([len(s.t) for s in stretches])[:-1]
        judged = []
        for stretch, begin, part in zip(stretches, begins, np.split(q, ends, axis=1), strict=True):
            count = THRESHOLDS.independent_hz * stretch.dt
            scaled = part[:, begin:] / self._noise * np.sqrt(min(1.0, count))
            flat = np.nan_to_num(scaled).reshape(len(scaled), -1)
            n = len(self._alive)
            slopes = (flat[n:] - flat[owners]) / np.array(sizes)[:, None]
            judged.append(self._judged(flat[:n], slopes, np.array(owners)))
        return judged

    def _neighbours(self) -> tuple[list[Hypothesis], list[int], list[float]]:
        """Hypotheses a share of a deviation away, whose neighbours they are, and that share.

        First those of all parameters, then those of the tolerances beside the claimed one.
        """
        found = [
            (hypothesis, owner, share)
            for owner, of in enumerate(self._alive)
            for hypothesis, share in _moved(of)
        ]
        found += [((*self._alive[0].hypothesis, t.planted), 0, 1.0) for t in self._tolerances]
        return [h for h, _, _ in found], [o for _, o, _ in found], [share for *_, share in found]

    def _judged(
        self,
        motions: Float[np.ndarray, "alive value"],
        slopes: Float[np.ndarray, "neighbour value"],
        owners: Int[np.ndarray, " neighbour"],
    ) -> Expected:
        """What motions tell, in units of noise, with sensitivities one deviation large."""
        own, common = len(owners) - len(self._tolerances), len(self._alive)
        free = slopes[own:]
        apart = np.zeros((common, common))
        for i, j in itertools.combinations(range(common), 2):
            nuisance = np.vstack([slopes[:own][np.isin(owners[:own], (i, j))], free])
            r = (motions[i] - motions[j])[None]
            apart[i, j] = apart[j, i] = 0.5 * max(float(Beyond(nuisance).product(r, r)[0, 0]), 0.0)
        claimed = slopes[:own][owners[:own] == 0]
        seen = Beyond(free).product(claimed, claimed)
        _, information = np.linalg.slogdet(np.eye(len(claimed)) + 0.5 * (seen + seen.T))
        return Expected(apart, 0.5 * float(information))


class Beyond:
    """Inner products of what a nuisance, each part of it of size one, does not explain.

    aᵀ(I + T Tᵀ)⁻¹ b, by Woodbury's identity.
    """

    def __init__(self, nuisance: Float[np.ndarray, "part value"]) -> None:
        """Keep the parts, the columns of T."""
        self._nuisance = nuisance
        self._known = np.linalg.inv(np.eye(len(nuisance)) + nuisance @ nuisance.T)

    def product(
        self, a: Float[np.ndarray, "m value"], b: Float[np.ndarray, "n value"]
    ) -> Float[np.ndarray, "m n"]:
        """Of each of some with each of others."""
        t = self._nuisance
        return np.asarray(a @ b.T - (a @ t.T) @ self._known @ (t @ b.T))


def _moved(of: Alive) -> Iterator[tuple[Hypothesis, float]]:
    """A hypothesis with one parameter elsewhere at a time, and by how many deviations."""
    offset = 0
    for i, planted in enumerate(of.hypothesis):
        count = planted.effect.n_theta
        spread = of.spread[offset : offset + count]
        offset += count
        for k in np.flatnonzero(spread > 0.0):
            step = np.zeros(count)
            step[k] = _SHARE * spread[k]
            taken = planted.moved(step)[k] - planted.theta[k]
            if abs(taken) < 0.1 * step[k]:  # at a bound: the other way
                step = -step
                taken = planted.moved(step)[k] - planted.theta[k]
            if taken != 0.0:
                there = replace(planted, theta=planted.moved(step))
                yield (*of.hypothesis[:i], there, *of.hypothesis[i + 1 :]), taken / spread[k]
