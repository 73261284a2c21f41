"""How long a diagnosis takes is foretold, and what is said of it while it runs never goes back."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.diagnose import synthetic
from tests.physics import stool
from wt.diagnose import pace
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.pace import Expected, Pace, step_seconds
from wt.diagnose.result import Used
from wt.physics.planted import Hypothesis
from wt.physics.scene import Scene

EIGHT = (Used("a", "fit", 8.0, 100.0), Used("b", "holdout", 8.0, 100.0))


@dataclass
class Told:
    """What a pace says, on a clock that stands unless it is set."""

    now: float = 0.0
    shares: list[tuple[str, float]] = field(default_factory=list)
    expected: list[Expected] = field(default_factory=list)

    def pace(self) -> Pace:
        return Pace(
            lambda *stage: self.shares.append(stage), self.expected.append, lambda: self.now
        )


class Replays(Objective):
    """Take so long each, on the clock of a pace [s]."""

    def __init__(
        self, told: Told, seconds: float, forgets: bool = True, reference: float = 1.0
    ) -> None:
        self._told, self._seconds, self.forgets = told, seconds, forgets
        self._reference_s = reference
        errors = [SimpleNamespace(planted=object()) for _ in range(9)]
        self.tolerances = tuple(errors)  # type: ignore[arg-type]

    def reference(self, *_: object, **__: object) -> None:  # type: ignore[override]
        """What a search begins with is no replay of what it tries."""
        self._told.now += self._reference_s

    def evaluate(self, hypotheses: Sequence[Hypothesis], *_: object) -> None:  # type: ignore[override]
        assert len(set(hypotheses)) == len(hypotheses), "what is alike is replayed once"
        self._told.now += len(hypotheses) * self._seconds


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    path = tmp_path / "arm.xml"
    path.write_text(synthetic.ARM)
    return Scene(path)


def searching(told: Told, arm: Scene, replays: Replays, screen_s: float = 2.0) -> Pace:
    """A pace that has timed a screen and replays."""
    pace_ = told.pace()
    pace_.foretell(arm, 1e-3, 16.0, EIGHT)
    pace_.stage("screening hypotheses")
    told.now += screen_s
    pace_.time(replays)
    assert not told.expected, "what errs is not known yet"
    return pace_


@pytest.mark.parametrize("forgets", [True, False])
def test_a_search_costs_its_replays_and_its_screen(arm: Scene, forgets: bool) -> None:
    told = Told()
    pace_ = searching(told, arm, Replays(told, 0.05, forgets))
    pace_.search(1, 2)
    a_search = (1.0 if forgets else pace.KEEPING) * (
        2 * pace.OF_JOINT * 0.05 + pace.SCREENED * (2.0 - pace.LOADED_S) + 1.0
    )
    (expected,) = told.expected
    nothing = told.now + a_search + pace.PICTURES_S
    assert expected.nothing == pytest.approx(nothing)
    assert expected.each == pytest.approx(pace.EACH * a_search)
    assert expected.of(3) == pytest.approx(nothing + 3 * pace.EACH * a_search)
    pace_.search(2, 1)
    assert len(told.expected) == 1


@pytest.mark.parametrize(("times", "said"), [(1.0, 1), (10.0, 2)])
def test_a_floating_machine_is_told_of_before_it_is_smoothed_and_again_where_it_differs(
    tmp_path: Path, times: float, said: int
) -> None:
    told = Told()
    pace_ = told.pace()
    pace_.foretell(stool.scene(tmp_path), 1e-3, 5.0, EIGHT)
    (first,) = told.expected
    assert not first.again
    # the clock stood while steps were timed: only the screen was counted
    assert first.each is not None
    a_search = first.each / pace.EACH_FLOATING
    pace_.time(Replays(told, (times - 1.0) * a_search / pace.FLOATING, reference=0.0))
    pace_.search(1, 1)
    assert len(told.expected) == said
    assert told.expected[-1].again == (said == 2)


def test_many_joints_take_longer_to_linearise_than_to_search(arm: Scene) -> None:
    told = Told()
    searching(told, arm, Replays(told, 0.0, reference=100.0)).search(1, 1)
    (expected,) = told.expected
    assert expected.nothing - told.now > 100.0


def test_what_takes_minutes_is_said_before_it_is_smoothed(
    arm: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pace, "step_seconds", lambda *_: 1e-3)
    told = Told()
    told.pace().foretell(arm, 1e-3, 16.0, EIGHT)
    (first,) = told.expected
    assert first.nothing > pace.OF_JOINT * 1e-3 * 4000


def test_what_is_left_goes_with_the_time_that_was_searched(arm: Scene) -> None:
    told = Told()
    pace_ = searching(told, arm, Replays(told, 0.01))
    pace_.search(1, 1)
    began = told.now
    told.now += 7.0
    pace_.stage("estimating and proving")
    what, share = told.shares[-1]
    assert what == "estimating and proving"
    assert share == pytest.approx(told.now / (told.now + told.now - began))


def test_a_proof_that_comes_late_is_said_once(arm: Scene) -> None:
    told = Told()
    pace_ = searching(told, arm, Replays(told, 0.01))
    pace_.search(1, 1)
    (first,) = told.expected
    began = told.now
    told.now = 3.0 * first.of(1)
    pace_.search(2, 1)
    assert len(told.expected) == 1, "of a search's length nothing is known before it ends"
    pace_.stage("estimating and proving")
    later = told.expected[-1]
    assert later.again and later.each is None
    assert later.of(1) == pytest.approx(told.now + (told.now - began))
    pace_.search(2, 1)
    pace_.stage("estimating and proving")
    assert len(told.expected) == 2


def test_what_is_done_stays_done(arm: Scene) -> None:
    told = Told()
    pace_ = told.pace()
    pace_.stage("auditing")
    pace_.foretell(arm, 1e-3, 16.0, EIGHT)
    pace_.search(1, 2)
    for now, rounds in ((1.0, 1), (50.0, 2), (60.0, 3)):
        told.now = now
        pace_.search(rounds + 1, 1)
    pace_.stage("estimating and proving")
    told.now = 65.0
    pace_.stage("recordings take turns")
    shares = [share for _, share in told.shares]
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] < 1.0


def test_a_step_is_timed_by_the_clock_that_is_given(arm: Scene, tmp_path: Path) -> None:
    ticks = itertools.count(0.0, 0.8)
    for scene in (arm, stool.scene(tmp_path)):
        assert step_seconds(scene, 1e-3, lambda: next(ticks)) == pytest.approx(0.8 / (16 * 200))


def test_the_sentence_is_as_rough_as_what_it_says() -> None:
    assert str(Expected(13.2, 4.0)) == (
        "this takes about 15 s if nothing is missing, and 5 s more for each effect that is found"
    )
    assert str(Expected(13.2, 4.0, again=True)).startswith("it turns out that all of this takes")
    assert str(Expected(130.0, None)) == "this takes about 2 min"
    assert str(Expected(130.0, 5e4)).startswith(
        "this takes about 2 min if nothing is missing, and 13.9 h more"
    )
