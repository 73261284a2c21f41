"""Only the operator moves a run on; damping is always one wish away, and faults stay."""

from __future__ import annotations

import itertools

import pytest

from deploy.stages import Fault, Stage, Status, Wish, step

FAULT = Fault("tilt", "the trunk is tilted")


def test_the_way_through() -> None:
    status = Status()
    for wish, stands, stage in (
        (None, False, Stage.PASSIVE),
        (Wish.POLICY, True, Stage.PASSIVE),  # nobody walks before standing
        (Wish.STAND, False, Stage.STAND),
        (Wish.POLICY, False, Stage.STAND),  # not there yet
        (Wish.POLICY, True, Stage.POLICY),
        (Wish.STAND, True, Stage.POLICY),
        (Wish.DAMPING, True, Stage.DAMPING),
        (Wish.POLICY, True, Stage.DAMPING),
        (Wish.STAND, False, Stage.STAND),  # and up again
        (Wish.QUIT, False, Stage.DAMPING),
    ):
        status = step(status, wish, None, stands)
        assert status == Status(stage)


@pytest.mark.parametrize("stage", list(Stage))
def test_damping_from_anywhere(stage: Stage) -> None:
    for wish, stands in itertools.product((Wish.DAMPING, Wish.QUIT), (True, False)):
        assert step(Status(stage), wish, None, stands).stage is Stage.DAMPING
    for wish, stands in itertools.product((None, *Wish), (True, False)):
        assert step(Status(stage), wish, FAULT, stands) == Status(Stage.DAMPING, FAULT)


def test_the_first_fault_stays() -> None:
    status = step(Status(Stage.POLICY), None, FAULT, True)
    for wish, fault in itertools.product((None, *Wish), (None, Fault("battery", "empty"))):
        status = step(status, wish, fault, True)
        assert status == Status(Stage.DAMPING, FAULT)
