"""How long a diagnosis takes: foretold from the machine and its recordings, then from each step.

Most of it goes into rounds of the search, and a round into two things: replays, some of which are
timed as the search begins; and the screen of forces, whose time goes with the samples. How many
rounds the whole takes depends on what is found. Where the base floats, or joints are many, even the
way to the search takes long: there a physics step is timed first, and it is said again what comes
out otherwise.

The constants come from diagnoses of the examples ``arm`` and ``cart``, of 7 toys
(``benchmarks/toys.py``), and of trials of one, two, three and six joints; where the base floats,
from those of a simulated Go2 that walks, with nothing hidden and with one effect.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from wt.batch import Batch
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.steps import COARSE
from wt.diagnose.likelihood.tolerances import tolerances
from wt.diagnose.recordings.smooth import FINEST_S
from wt.diagnose.result import Used
from wt.physics.scene import Scene
from wt.show.text import duration

Say = Callable[[str, float], None]
"""Called with (what is being done, share of the whole 0…1)."""

ROUND, OF_JOINT, KEEPING = 95, 100, 1.35
"""Replays of a round of the search, and for each joint that errs: 240 to 860 in all; and how many
times more where a machine keeps its initial state: it is fitted too, and windows may grow."""
LINEARISED = 2.0
"""Linearisations of all that may adapt that a round takes at least: with many joints these are more
replays than :data:`ROUND`."""
FLOATING, FEET = 370.0, 3.5
"""Replays of a round where the base floats, whatever errs; and how many times longer they take
than such a machine at rest: feet land, and coarse steps do not do."""
LIVE_S, SCREEN_S = 3e-7, 1.5e-3
"""Time that laws which act at every step add to a step on average, and that the screen takes for a
sample of one joint [s]. What is between steps, and the screen, are Python's."""
NOTHING = 1.25
"""Time of a diagnosis that finds nothing, from the first round on and in rounds."""
EACH, EACH_FLOATING = 0.6, 2.0
"""… and more for each effect that it finds: 0 to 1.7, and 1.4 to 2.8 where the base floats."""
_PROBES, _PROBED = 16, 200  # replays and steps of a machine that are timed
_TIMED = 4  # … and of recordings
_EARLY_S = 60.0
"""A round that takes so long, as far as the machine at rest tells, is said before all else [s]."""
_OTHERWISE = 1.5
"""What takes so many times longer than was said, or shorter, is said again."""

Stage = Literal[
    "auditing", "smoothing", "screening hypotheses", "estimating and proving",
    "looking for events", "naming", "recordings take turns", "preparing pictures",
]  # fmt: skip
_WHOLE = NOTHING + 0.5 * EACH
_LEFT = dict(zip(get_args(Stage), (0.0, _WHOLE, _WHOLE, 0.4, 0.2, 0.2, _WHOLE, 0.1), strict=True))
"""What is left as each stage begins, in rounds: an effect is as likely found as none."""


@dataclass(frozen=True)
class Expected:
    """How long a diagnosis will take [s].

    Attributes:
        nothing: if nothing is found.
        each: … and so much more for each effect that is.
        again: whether it was said before, otherwise.
    """

    nothing: float
    each: float
    again: bool = False

    def __str__(self) -> str:
        """In a sentence."""
        this = "it turns out that all of this takes" if self.again else "this takes"
        return (
            f"{this} about {duration(self.nothing)} if nothing is missing, and "
            f"{duration(self.each)} more for each effect that is found"
        )

    def differs(self, other: Expected) -> bool:
        """Whether another one makes it another wait."""
        return not 1.0 / _OTHERWISE < self.nothing / max(other.nothing, 1e-9) < _OTHERWISE


class Pace:
    """Says what is being done, and foretells when all of it will be.

    A share is that of the time: of what has passed in what it will take in all.
    """

    def __init__(
        self,
        say: Say | None,
        expect: Callable[[Expected], None] | None,
        clock: Callable[[], float] = time.monotonic,
        cpu: Callable[[], float] = time.process_time,
    ) -> None:
        """Begin to count.

        Args:
            say: is told of each stage.
            expect: is told how long it will take, once that is known, and again where it changes.
            clock: [s]
            cpu: time that this process has computed [s].
        """
        self._say, self._expect, self._clock = say, expect, clock
        self._began, self._computed, self._share = clock(), cpu(), 0.0
        self._cpu, self._replay, self._live, self._screen = cpu, 0.0, 0.0, 0.0
        self._floats, self._more, self._proved = False, 1.0, False
        self._reference = 0.0
        self._said: Expected | None = None
        self._round: float | None = None
        self._round_began: float | None = None

    def foretell(
        self, scene: Scene, step: float, seconds: float, recordings: Sequence[Used]
    ) -> None:
        """Measure how fast replays are, and say how long all will take, if it takes long.

        Args:
            scene: the machine.
            step: physics step of replays while hypotheses are compared [s].
            seconds: at most so much of the recordings is replayed meanwhile [s].
            recordings: all of them.
        """
        fitted = [u for u in recordings if u.role == "fit"]
        steps = min(seconds, sum(u.seconds for u in fitted)) / (COARSE * step)
        samples = sum(u.seconds * min(u.rate_hz, 1.0 / FINEST_S) for u in fitted)
        # other work on this machine slows Python down as it has done till here
        slower = max(1.0, self._passed() / max(self._cpu() - self._computed, 1e-9))
        self._live, self._screen = (
            LIVE_S * slower * steps,
            SCREEN_S * slower * samples * scene.model.nv,
        )
        self._floats = bool(scene.free)
        at_rest = step_seconds(scene, COARSE * step, self._clock)
        self._replay = (FEET if self._floats else 1.0) * at_rest * steps + self._live
        adapting = LINEARISED * (len(tolerances(scene)) + 2 * scene.model.nv)
        replays = FLOATING if self._floats else max(ROUND, adapting) + OF_JOINT
        # where the way to the search is short, it says so better
        if self._floats or replays * self._replay + self._screen > _EARLY_S:
            self._announce(replays * self._replay)

    def time(self, replays: Objective) -> None:
        """Measure how long the search's replays take on this machine, at present."""
        began = self._clock()
        replays.reference(())  # where the search begins
        self._reference = self._clock() - began
        # as different as those of a search are: what is alike in several is replayed once
        different = [(error.planted,) for error in replays.tolerances[:_TIMED]]
        began = self._clock()
        replays.evaluate(different or [()])
        self._replay = (self._clock() - began) / max(len(different), 1) + self._live
        self._more = 1.0 if replays.forgets else KEEPING

    def stage(self, stage: Stage) -> None:
        """A stage begins."""
        self._measure()
        self._proved |= stage == "estimating and proving"
        self._tell(stage, _LEFT[stage])

    def search(self, number: int, erring: int) -> None:
        """A round of the search begins.

        Args:
            number: of the effect that is looked for, counted from 1.
            erring: how many joints err.
        """
        self._measure()
        if number == 1:
            fixed = max(self._more * ROUND * self._replay, self._reference)
            each = self._more * OF_JOINT * erring * self._replay
            self._announce(FLOATING * self._replay if self._floats else fixed + each)
        elif self._proved:
            self._search_on(number - 1)
        self._round_began = self._clock()
        self._tell(f"looking for effect {number}", _WHOLE if number == 1 else NOTHING)

    def _announce(self, replays_s: float) -> None:
        self._round = replays_s + self._screen
        nothing = self._passed() + NOTHING * self._round
        each = (EACH_FLOATING if self._floats else EACH) * self._round
        self._promise(Expected(nothing, each, again=self._said is not None))

    def _search_on(self, found: int) -> None:
        """A proof refused some of what was found, and others are looked for: nobody foresaw it."""
        if self._said and self._round:
            each = self._said.each
            nothing = self._passed() + NOTHING * self._round - found * each
            self._promise(Expected(max(nothing, self._said.nothing), each, again=True))

    def _promise(self, expected: Expected) -> None:
        if self._said is None or expected.differs(self._said):
            self._said = expected
            if self._expect:
                self._expect(expected)

    def _measure(self) -> None:
        """What a round really took says what the others will."""
        if self._round_began is not None:
            self._round, self._round_began = self._clock() - self._round_began, None

    def _tell(self, what: str, rounds: float) -> None:
        passed, left = self._passed(), rounds * (self._round or 0.0)
        if left > 0.0:  # what was said to be done stays so
            self._share = max(self._share, passed / (passed + left))
        if self._say:
            self._say(what, self._share)

    def _passed(self) -> float:
        return self._clock() - self._began


def step_seconds(scene: Scene, step: float, clock: Callable[[], float] = time.monotonic) -> float:
    """Time that a physics step of one of many replays takes on this machine, at present [s]."""
    spec = scene.spec()
    spec.option.timestep = step
    batch = Batch(spec.compile(), nsim=_PROBES)
    batch.rollout(1)  # wakes its threads
    began = clock()
    batch.rollout(_PROBED)
    return (clock() - began) / (_PROBES * _PROBED)
