"""Ages are those of messages that a test delays by known times."""

from __future__ import annotations

import math

import pytest

from deploy.ageing import Ageing


def fed(ageing: Ageing, seconds: float, begin: float = 50.0, drift: float = 0.0) -> float:
    """Let states arrive 1 ms after they were taken, 50 a second; returns the last arrival."""
    now = begin
    for k in range(round(seconds * 50)):
        now = begin + k * 0.02
        ageing.heard(now, 7.0 + (now - begin) * (1 + drift) - 0.001)
    return now


def test_nothing_heard_is_infinitely_old() -> None:
    assert Ageing().age(3.0) == math.inf


def test_silence_ages() -> None:
    ageing = Ageing()
    now = fed(ageing, 1.0)
    assert ageing.age(now) == pytest.approx(0.0, abs=1e-9)
    assert ageing.age(now + 0.025) == pytest.approx(0.025)


def test_a_late_state_is_as_old_as_it_is_late() -> None:
    ageing = Ageing()
    now = fed(ageing, 1.0)
    ageing.heard(now + 0.1, 7.0 + (now - 50.0) - 0.001 + 0.002)
    assert ageing.age(now + 0.1) == pytest.approx(0.098)


def test_clocks_that_drift_do_not_age() -> None:
    """100 ppm for ten minutes would be 60 ms."""
    ageing = Ageing()
    now = fed(ageing, 600.0, drift=-1e-4)
    assert ageing.counts() and ageing.age(now) < 0.0025


def test_a_clock_that_stands_still_is_left_alone() -> None:
    ageing = Ageing()
    for k in range(1000):
        ageing.heard(k * 0.002, 5.0)
    assert not ageing.counts()
    assert ageing.age(1.998 + 0.02) == pytest.approx(0.02)
