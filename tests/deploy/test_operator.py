"""Remote, keyboard and signals, as bytes, keys and signals."""

from __future__ import annotations

import os
import signal
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from deploy.operator import HumanOperator, Keyboard, wish_of
from deploy.remote import SIZE, Remote
from deploy.stages import Wish

LARGEST = (1.0, 0.5, 2.0)


def raw(*bits: int, lx: float = 0.0, rx: float = 0.0, ly: float = 0.0) -> bytes:
    """By the maker's layout: buttons from the third byte on, then the sticks' axes."""
    held = sum(1 << bit for bit in bits)
    return struct.pack("<2xHfffff16x", held, lx, rx, 0.7, 0.0, ly)


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> int:
    """A pipe to the keyboard; what is written to it is typed."""
    out, into = os.pipe()
    monkeypatch.setattr(sys, "stdin", os.fdopen(out))
    return into


def test_buttons_are_where_the_maker_has_them() -> None:
    assert Remote.unpack(raw(5, 9)).buttons == {"L2", "B"}
    assert wish_of(Remote.unpack(raw(5, 9))) is Wish.DAMPING
    assert wish_of(Remote.unpack(raw(5, 8))) is Wish.STAND
    assert wish_of(Remote.unpack(raw(2))) is Wish.POLICY
    assert wish_of(Remote.unpack(raw(5))) is wish_of(Remote.unpack(raw(9))) is None
    assert wish_of(Remote.unpack(raw(2, 5, 8, 9))) is Wish.DAMPING


def test_sticks_point_where_the_robot_goes() -> None:
    remote = Remote.unpack(raw(lx=0.5, rx=1.0, ly=0.25))
    assert (remote.forward, remote.left, remote.turn) == (0.25, -0.5, -1.0)
    odd = Remote.unpack(raw(lx=float("nan"), ly=7.0))
    assert (odd.forward, odd.left) == (1.0, 0.0)


def test_packing_is_the_inverse() -> None:
    remote = Remote(frozenset({"L2", "A", "start"}), 0.5, -0.25, 1.0)
    packed = remote.pack()
    assert len(packed) == SIZE == len(raw())
    assert Remote.unpack(packed) == remote


def test_keys_wish_and_walk(keys: int) -> None:
    keyboard = Keyboard()
    assert keyboard.poll() is None
    os.write(keys, b"1")
    assert keyboard.poll() is Wish.STAND and keyboard.poll() is None
    os.write(keys, b"2wwwadqq")
    assert keyboard.poll() is Wish.POLICY
    np.testing.assert_allclose(keyboard.steps, [0.3, 0.0, 0.2])
    os.write(keys, b"0ssssssssssssssss ")
    assert keyboard.poll() is Wish.DAMPING
    np.testing.assert_allclose(keyboard.steps, [-1.0, 0.0, 0.0])


def test_a_keyboard_that_goes_away_ends_the_run_if_it_was_used(keys: int) -> None:
    unused, operator = Keyboard(), HumanOperator(LARGEST)
    os.write(keys, b"1")
    assert operator.poll(Remote())[0] is Wish.STAND
    os.close(keys)
    assert operator.poll(Remote())[0] is Wish.QUIT
    assert unused.poll() is None  # nobody was there


def test_damping_wins_and_commands_are_scaled(keys: int) -> None:
    operator = HumanOperator(LARGEST)
    os.write(keys, b"wwd1")
    wish, told = operator.poll(Remote(frozenset({"L2", "B"}), forward=0.5, turn=-1.0))
    assert wish is Wish.DAMPING
    np.testing.assert_allclose(told, [0.7, -0.05, -2.0])
    os.write(keys, b"wwwwwwwww")
    np.testing.assert_allclose(operator.poll(Remote(forward=0.5))[1], [1.0, -0.05, 0.0])


@pytest.mark.parametrize("which", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_the_run_and_are_given_back(which: signal.Signals, keys: int) -> None:
    before = signal.getsignal(which)
    operator = HumanOperator(LARGEST)
    with operator.attending():
        assert operator.poll(Remote())[0] is None and not operator.ended()
        os.kill(os.getpid(), which)
        assert operator.poll(Remote())[0] is Wish.QUIT and operator.ended()
        assert operator.poll(Remote())[0] is Wish.QUIT
    assert signal.getsignal(which) is before


def test_without_a_keyboard_there_is_the_remote(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "empty").touch()
    with (tmp_path / "empty").open() as nothing:
        for stdin in (None, nothing):
            monkeypatch.setattr(sys, "stdin", stdin)
            operator = HumanOperator(LARGEST)
            with operator.attending():
                assert operator.poll(Remote(frozenset({"start"})))[0] is Wish.POLICY
