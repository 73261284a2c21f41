"""How long a diagnosis takes: foretold from the machine and its recordings, then from each step.

Two things are timed as the search begins: replays of this machine, and the screen of forces, which
has just been made of these recordings. A search takes so many of each, and more for every effect
that it finds. Once it is over, what is left goes with the time that it took. Where the base floats,
or joints are many, even the way to the search takes long: there a physics step is timed first.

The constants are fits to the times of 163 trials of ``wt prove`` (one, two, three and six joints;
nothing, one and several effects), of 17 recordings of real machines, arms and legs, and of the
examples; where the base floats, of two Go2.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

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

OF_JOINT, SCREENED, LOADED_S, PICTURES_S = 40, 11.0, 0.3, 1.0
"""Replays of a search for each joint that errs; how many times longer than the screen, but for what
is loaded with it [s], it asks for hypotheses; and what pictures take in the end [s]."""
KEEPING = 2.0
"""How many times longer all takes where a machine keeps its initial state: it is fitted too,
windows may grow, and a proof refuses more."""
LINEARISED = 2.0
"""Linearisations of all that may adapt that a search takes at least: with many joints these are
most of its replays."""
FLOATING, FEET = 370.0, 3.5
"""Replays of a search where the base floats, whatever errs; and how many times longer they take
than such a machine at rest: feet land, and coarse steps do not do."""
SCREEN_S = 1.5e-3
"""Time beside replays that a search takes for a sample of one joint, before the screen is timed
[s]."""
EACH, EACH_FLOATING = 0.6, 3.0
"""… and more for each effect that it finds, in searches that find nothing."""
_PROBES, _PROBED = 16, 200  # replays and steps of a machine that are timed
_TIMED = 4  # … and of recordings
_EARLY_S = 60.0
"""Replays that take so long, as far as the machine at rest tells, are said before all else [s]."""
_OTHERWISE = 1.5
"""What takes so many times longer than was said, or shorter, is said again."""

Stage = Literal[
    "auditing", "smoothing", "screening hypotheses", "estimating and proving",
    "looking for events", "naming", "recordings take turns", "preparing pictures",
]  # fmt: skip
_FIRST = 1.0 + EACH
"""What all takes, in searches that find nothing, if one effect is found."""
_SEARCHING = 1.5
_LEFT = dict(zip(get_args(Stage), (0.0, 0.0, 0.0, 1.0, 0.3, 0.3, 1.0, 0.15), strict=True))
"""What is left as another effect is looked for, and as each stage begins, in times that have passed
since the search began."""


@dataclass(frozen=True)
class Expected:
    """How long a diagnosis will take [s].

    Attributes:
        nothing: if nothing is found; or in all, once the search says that.
        each: … and so much more for each effect that is; None once it is of no matter.
        again: whether it was said before, otherwise.
    """

    nothing: float
    each: float | None
    again: bool = False

    def __str__(self) -> str:
        """In a sentence."""
        this = "it turns out that all of this takes" if self.again else "this takes"
        if self.each is None:
            return f"{this} about {duration(self.nothing)}"
        return (
            f"{this} about {duration(self.nothing)} if nothing is missing, and "
            f"{duration(self.each)} more for each effect that is found"
        )

    def of(self, found: int) -> float:
        """If so many effects are found."""
        return self.nothing + found * (self.each or 0.0)


class Pace:
    """Says what is being done, and foretells when all of it will be.

    A share is that of the time: of what has passed in what it will take in all.
    """

    def __init__(
        self,
        say: Say | None,
        expect: Callable[[Expected], None] | None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count.

        Args:
            say: is told of each stage.
            expect: is told how long it will take, once that is known, and again where it changes.
            clock: [s]
        """
        self._say, self._expect, self._clock = say, expect, clock
        self._began, self._share = clock(), 0.0
        self._replay = self._screen = self._reference = 0.0
        self._floats = self._keeps = False
        self._found = self._proofs = 0
        self._said: Expected | None = None
        self._screening: float | None = None
        self._searching: float | None = None

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
        self._screen = SCREEN_S * samples * scene.model.nv
        self._floats = bool(scene.free)
        at_rest = step_seconds(scene, COARSE * step, self._clock)
        self._replay = (FEET if self._floats else 1.0) * at_rest * steps
        adapting = LINEARISED * (len(tolerances(scene)) + 2 * scene.model.nv)
        # which joints err is not known yet: all may
        search = OF_JOINT * scene.model.nv
        replays_s = (FLOATING if self._floats else adapting + search) * self._replay
        # where the way to the search is short, it says so better
        if self._floats or replays_s > _EARLY_S:
            self._announce(replays_s + self._screen)

    def time(self, replays: Objective) -> None:
        """Measure how long the search's replays take on this machine, at present."""
        began = self._clock()
        if self._screening is not None:
            self._screen = SCREENED * max(began - self._screening - LOADED_S, 0.0)
        replays.reference(())  # where the search begins
        self._reference = self._clock() - began
        # as different as those of a search are: what is alike in several is replayed once
        different = [(error.planted,) for error in replays.tolerances[:_TIMED]]
        began = self._clock()
        replays.evaluate(different or [()])
        self._replay = (self._clock() - began) / max(len(different), 1)
        self._keeps = not replays.forgets

    def stage(self, stage: Stage) -> None:
        """A stage begins."""
        if stage == "screening hypotheses":
            self._screening = self._clock()
        left = _LEFT[stage] * self._searched()
        if stage == "estimating and proving":
            self._proofs += 1  # each refuses less
            left /= self._proofs
        if left > 0.0:
            self._in_all(self._passed() + left)
        self._tell(stage, left)

    def search(self, number: int, erring: int) -> None:
        """A round of the search begins.

        Args:
            number: of the effect that is looked for, counted from 1.
            erring: how many joints err.
        """
        self._found = number - 1
        if self._searching is None:
            self._searching = self._clock()
            replays = FLOATING if self._floats else OF_JOINT * erring
            long = KEEPING if self._keeps and not self._floats else 1.0
            round_s = long * (replays * self._replay + self._reference + self._screen)
            self._announce(round_s)
            left = _FIRST * round_s
        else:
            left = _SEARCHING * self._searched()
        self._tell(f"looking for effect {number}", left)

    def _announce(self, search_s: float) -> None:
        """What a search takes that finds nothing says what all will."""
        nothing = self._passed() + search_s + PICTURES_S
        each = (EACH_FLOATING if self._floats else EACH) * search_s
        times = nothing / max(self._said.nothing, 1e-9) if self._said else np.inf
        if not 1.0 / _OTHERWISE < times < _OTHERWISE:
            self._promise(Expected(nothing, each, again=self._said is not None))

    def _in_all(self, seconds: float) -> None:
        """What has passed says that all will take so long."""
        if self._said and seconds > _OTHERWISE * self._said.of(self._found):
            self._promise(Expected(seconds, None, again=True))

    def _promise(self, expected: Expected) -> None:
        self._said = expected
        if self._expect:
            self._expect(expected)

    def _tell(self, what: str, left: float) -> None:
        passed = self._passed()
        if left > 0.0:  # what was said to be done stays so
            self._share = max(self._share, passed / (passed + left))
        if self._say:
            self._say(what, self._share)

    def _passed(self) -> float:
        return self._clock() - self._began

    def _searched(self) -> float:
        """Time since the first search began [s]."""
        return 0.0 if self._searching is None else self._clock() - self._searching


def step_seconds(scene: Scene, step: float, clock: Callable[[], float] = time.monotonic) -> float:
    """Time that a physics step of one of many replays takes on this machine, at present [s]."""
    spec = scene.spec()
    spec.option.timestep = step
    batch = Batch(spec.compile(), nsim=_PROBES)
    batch.rollout(1)  # wakes its threads
    began = clock()
    batch.rollout(_PROBED)
    return (clock() - began) / (_PROBES * _PROBED)
