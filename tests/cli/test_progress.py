"""Where stderr is no terminal, plain lines say that work goes on, and quick work says nothing."""

from __future__ import annotations

import functools
import time

import pytest

from wt.cli import _progress
from wt.cli._progress import Lines, bar, bars, waiting


def test_lines_say_the_step_its_share_and_the_time(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines(every=0.05) as lines:
        lines("naming", 0.8)
        time.sleep(0.5)
    out, err = capsys.readouterr()
    first, *_ = err.splitlines()
    assert first == "naming: 80 % after 0 s" and not out
    time.sleep(0.1)
    assert not capsys.readouterr().err


def test_lines_of_timed_work_say_what_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines(every=0.2, timed=True) as lines:
        time.sleep(0.1)
        lines("naming", 0.001)
        time.sleep(0.3)
    (line, *_) = capsys.readouterr().err.splitlines()
    # a thousandth took a tenth of a second
    assert line.startswith("naming: 0 % after 0 s, about ") and line.endswith(" to go")
    seconds, unit = line.split()[-4:-2]
    assert float(seconds) * {"s": 1, "min": 60}[unit] == pytest.approx(120.0, rel=0.4)


def test_the_share_of_timed_work_grows_within_a_step(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_progress, "_AT_LEAST", 0.0)
    with Lines(every=0.2, timed=True) as lines:
        time.sleep(0.1)
        lines("naming", 0.1)  # so that all takes a second
        time.sleep(0.4)
        lines("proving", 0.4)
        time.sleep(0.3)
    shares = [int(line.split()[1]) for line in capsys.readouterr().err.splitlines()]
    assert len(shares) >= 3 and shares == sorted(shares)
    assert 15 <= shares[0] < shares[-1] <= 99


def test_quick_work_says_nothing_and_draws_no_bar(capsys: pytest.CaptureFixture[str]) -> None:
    with bar("reading") as say:
        say("naming", 0.5)
    with bars() as listener:
        listener.progress("training", 1, 2)
    assert capsys.readouterr().err == ""


def test_nothing_is_said_while_the_terminal_is_somebody_else_s(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Lines(every=0.05) as lines:
        lines("naming", 0.8)
        with lines.aside():
            time.sleep(0.3)
            assert not capsys.readouterr().err
        time.sleep(0.3)
    assert capsys.readouterr().err.startswith("naming: 80 %")


def test_a_bar_makes_room_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with bar("reading") as drawn:
        drawn("naming", 0.5)
        with drawn.aside():
            capsys.readouterr()
            time.sleep(0.3)
            assert not capsys.readouterr().err
        time.sleep(0.3)
        assert "naming" in capsys.readouterr().err


def test_warnings_are_printed_in_a_log_too(capsys: pytest.CaptureFixture[str]) -> None:
    with bars() as listener:
        listener.warn("the run collapses [z]")
    assert capsys.readouterr().err == "warning: the run collapses [z]\n"


def test_steps_of_work_that_waits_are_lines_of_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    with waiting("two diagnoses") as (say, note):
        note("arm: naming: 80 %")
        say("found")
    out, err = capsys.readouterr()
    assert (out, err) == ("found\n", "arm: naming: 80 %\n")


def test_a_line_says_where_all_stages_under_way_are(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_progress, "Lines", functools.partial(Lines, every=0.05))
    with bars() as listener:
        for what, done in (("a", 1), ("b", 2), ("a", 3), ("c", 4)):
            listener.progress(what, done, 4)
        time.sleep(0.5)
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "a: 75 %, b: 50 % after 0 s"
