"""The next experiment: safe on every machine that the recordings leave, and it tells them apart.

Motions from rest to rest are offered: of one joint creeping, slow and fast reversals, steps, a
multisine and rests at several angles, each in two sizes, and a way towards either end; of the
whole machine, rests in other poses. Each is made smaller until no hypothesis leaves what the
machine has shown and its model allows; what stays unsafe is left out. The motions that tell most
for their time are then set one after another until it is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from wt.ask import SOURCE
from wt.ask.alive import Alive
from wt.ask.limits import Limits, forces
from wt.ask.separation import Expected, Separation
from wt.diagnose.experiment.motions import singles, sweeps, telling_joints, together
from wt.diagnose.experiment.reach import Reach, roomy, too_far
from wt.diagnose.experiment.trial import Trial, as_recording, touching_along, trial
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.replay import Stretch
from wt.physics.scene import Scene
from wt.types import Recording

PART_S = 5.0
"""Length of the motions of one joint [s]."""
SETTLE_S = 1.0
"""A machine stands still for so long before the first [s]: then it is in balance."""
_JOINTS = 3
"""At most so many joints are moved in an experiment."""
_SHRINK, _TRIES = 0.75, 6
_ENOUGH = THRESHOLDS.min_nats
"""Two hypotheses that an experiment takes so far apart [nats] need not come further apart."""
_TELLING = THRESHOLDS.equivalent_nats
"""An experiment that takes no two further apart than this [nats] tells nothing."""
_SHARPER = 0.2
"""… and one that makes parameters known no better than by so many nats."""
_LOOK_S = 0.02
"""Distance of the poses that are looked at for contacts [s]."""


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment to run.

    Attributes:
        commands: to send, with the positions that the model as given expects.
        motions: what it does, in words, one after another.
        expected: what it is expected to tell.
    """

    commands: Recording
    motions: tuple[str, ...]
    expected: Expected


@dataclass(frozen=True, eq=False)
class _Part:
    """A motion that is offered.

    Attributes:
        words: what it does.
        wanted: joint positions, from rest to rest.
        tried: the same, simulated on the model as given.
        expected: what it tells.
    """

    words: str
    wanted: Float[np.ndarray, "sample dof"]
    tried: Trial
    expected: Expected | None = None


@dataclass(frozen=True, eq=False)
class Designer:
    """Designs experiments for one machine.

    Attributes:
        scene: the machine.
        reach: what its joints may do.
        rate: of commands [Hz].
        separation: judges what they tell.
        alive: the hypotheses.
        limits: what its drives may give, and where it may be.
    """

    scene: Scene
    reach: Reach
    rate: float
    separation: Separation
    alive: Sequence[Alive]
    limits: Limits

    def design(self, seconds: float, seed: int, sharpen: bool) -> Design | None:
        """The experiment to run next.

        Args:
            seconds: length, at most.
            seed: of steps.
            sharpen: whether parameters are to be known better, too.

        Returns:
            None where nothing safe would tell more.
        """
        most = round((seconds - SETTLE_S) * self.rate)
        chosen = _chosen(self._judged(self._safe(self._offered(most, seed))), most, sharpen)
        if not chosen:
            return None
        whole = np.concatenate([self._still(), *(p.wanted for p in chosen)])
        for _ in range(_TRIES):  # one after another they may meet what each alone does not
            at_once = self._part("", whole)
            if self._is_safe([at_once]) == [True]:
                break
            whole = self.reach.smaller(whole, _SHRINK)
        else:
            return None
        expected = _expected(*self._judged([at_once]))
        if not _tells(expected, sharpen):
            return None
        motions = tuple(p.words for p in chosen)
        what = "; then ".join(motions)
        commands = as_recording(self.scene, at_once.tried, self.rate, SOURCE, what)
        return Design(commands, motions, expected)

    def _offered(self, most: int, seed: int) -> list[_Part]:
        """Motions of at most so many samples."""
        rng, n, dt = np.random.default_rng(seed), round(PART_S * self.rate), 1.0 / self.rate
        parts = [
            self._part(f"{joint} {words}", wanted)
            for joint in self._joints()
            for words, wanted in (
                *singles(self.scene, self.reach, joint, n, dt, rng),
                *sweeps(self.scene, self.reach, joint, most, dt),
            )
        ]
        poses = together(self.scene, self.reach, most, dt, rng)
        return parts + [self._part(words, wanted) for words, wanted in poses]

    def _joints(self) -> list[str]:
        """Driven joints that tell most about where hypotheses differ, or about what is claimed."""
        differ = [a.differs.at for a in self.alive if a.differs is not None]
        claimed = [p.at for p in self.alive[0].hypothesis]
        driven = {d.joint for d in self.scene.drives if roomy(self.reach, d.dof)}
        near = [j for at in (*differ, *claimed) for j in telling_joints(self.scene, at)]
        return [j for j in dict.fromkeys(near) if j in driven][:_JOINTS]

    def _safe(self, parts: Sequence[_Part]) -> list[_Part]:
        """The parts, each made smaller until it is safe; without those that never are."""
        safe, left = [], list(parts)
        for _ in range(_TRIES):
            if not left:
                break
            good = list(zip(left, self._is_safe(left), strict=True))
            safe += [p for p, ok in good if ok]
            left = [
                self._part(p.words, self.reach.smaller(p.wanted, _SHRINK))
                for p, ok in good
                if not ok
            ]
        return safe

    def _is_safe(self, parts: Sequence[_Part]) -> list[bool]:
        """Whether no hypothesis, nor the model as given, leaves what is allowed."""
        given = [
            not too_far(self.scene, self.reach, p.tried, self.rate).any()
            and not self.limits.broken(p.tried.force, p.tried.q)
            for p in parts
        ]
        asked = [p for p, ok in zip(parts, given, strict=True) if ok]
        motions = iter(self.separation.motions([self._stretch(p)[0] for p in asked]))
        return [ok and self._all_stay(p, next(motions)) for p, ok in zip(parts, given, strict=True)]

    def _all_stay(self, part: _Part, motions: Float[np.ndarray, "alive sample dof"]) -> bool:
        each = max(1, round(_LOOK_S * self.rate))
        for q in motions[:, -len(part.wanted) :]:
            if not np.isfinite(q).all():
                return False
            # a machine that stands beside where its model would goes as far beside it elsewhere
            beside = np.abs(q[0] - self.reach.rest)
            reach = replace(self.reach, slack=self.reach.slack + beside)
            if too_far(self.scene, reach, replace(part.tried, q=q), self.rate).any():
                return False
            if len(touching_along(self.scene, q[::each])):
                return False
            # what its drives would have to give, were it this machine
            force = forces(self.scene, part.tried.ctrl, q, np.gradient(q, 1.0 / self.rate, axis=0))
            if self.limits.broken(force, q):
                return False
        return True

    def _judged(self, parts: Sequence[_Part]) -> list[_Part]:
        if not parts:
            return []
        stretches, begins = zip(*(self._stretch(p) for p in parts), strict=True)
        expected = self.separation.expected(stretches, begins)
        return [replace(p, expected=e) for p, e in zip(parts, expected, strict=True)]

    def _part(self, words: str, wanted: Float[np.ndarray, "sample dof"]) -> _Part:
        return _Part(words, wanted, trial(self.scene, wanted, self.rate))

    def _still(self) -> Float[np.ndarray, "sample dof"]:
        return np.tile(self.reach.rest, (round(SETTLE_S * self.rate), 1))

    def _stretch(self, part: _Part) -> tuple[Stretch, int]:
        """A part as replays take it, after standing still; and its first sample."""
        before = len(self._still())
        ctrl, begun = part.tried.ctrl, part.tried.begun
        command = np.concatenate([np.tile(ctrl[0], (before, 1)), ctrl])
        t, rest = np.arange(len(command)) / self.rate, self.reach.rest
        return Stretch(0, t, command, rest, np.zeros_like(rest), activation=begun), before


def _chosen(parts: Sequence[_Part], samples: int, sharpen: bool) -> list[_Part]:
    """The parts that tell most for their time, each once at most."""
    chosen: list[_Part] = []
    told = np.zeros_like(_expected(parts[0]).apart) if parts else np.zeros((0, 0))
    while True:
        used = sum(len(p.wanted) for p in chosen)
        left = [p for p in parts if p not in chosen and used + len(p.wanted) <= samples]
        gains = [_gain(told, _expected(p), sharpen) / len(p.wanted) for p in left]
        if not gains or max(gains) <= 0.0:
            return chosen
        best = left[int(np.argmax(gains))]
        told = told + _expected(best).apart
        chosen.append(best)


def _gain(told: Float[np.ndarray, "alive alive"], expected: Expected, sharpen: bool) -> float:
    """What a part adds to what is told: of each two hypotheses, until they are far enough apart."""
    before, after = (np.minimum(x, _ENOUGH).sum() for x in (told, told + expected.apart))
    return float(after - before) + sharpen * expected.information


def _tells(expected: Expected, sharpen: bool) -> bool:
    return expected.most > _TELLING or (sharpen and expected.information > _SHARPER)


def _expected(part: _Part) -> Expected:
    assert part.expected is not None
    return part.expected
