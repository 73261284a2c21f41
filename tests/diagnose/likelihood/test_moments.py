"""What acts at moments is told from tolerances, which are the same at all times."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import Hidden, chain, world
from wt.diagnose.likelihood.bic import erring
from wt.diagnose.likelihood.estimate import Estimated
from wt.diagnose.likelihood.moments import _lasting, momentary
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.verdict import left_over, verdict

SECONDS = 8.0


def brake(size: float, begin: float, end: float) -> Hidden:
    """Dry friction of the second joint for a part of the time [N·m, s]."""

    def drag(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if begin <= data.time < end:
            data.qfrc_applied[1] -= size * np.tanh(data.qvel[1] / 0.01)

    return drag


def test_a_brake_that_drags_for_a_while_is_something_however_small(tmp_path: Path) -> None:
    objective = world(tmp_path, 2, brake(0.08, 2.0, 4.6), SECONDS).objective
    now = objective.reference(())
    assert not erring(now, objective), "it is small beside the motion"
    moments = momentary(objective, now)
    assert list(moments) == ["j2"]
    assert 1.0 <= moments["j2"] <= 3.5
    claims = Claims((), Estimated(now, ()), (), (), moments=moments)
    assert verdict(claims, objective) == "unexplained"
    (found,) = left_over(claims, objective)
    assert (found.at.name, found.depends_on) == ("j2", ("t",))
    assert f"acts in {moments['j2']:.2g} s" in found.statement


@pytest.mark.parametrize(
    "machine",
    [
        chain(2),
        chain(2).replace(".03 .02 -.25", ".032 .021 -.25"),
        chain(2).replace('timestep="0.0005"', 'timestep="0.002"'),
        chain(2).replace('damping=".3"', 'damping=".3" stiffness=".1"'),
    ],
    ids=["as modelled", "links bent", "coarse steps", "springs"],
)
def test_what_a_model_is_always_off_by_is_at_no_moment(machine: str, tmp_path: Path) -> None:
    objective = world(tmp_path, 2, None, SECONDS, machine=machine).objective
    assert momentary(objective, objective.reference(())) == {}


@pytest.mark.parametrize(
    ("size", "halves", "fast", "between", "said"),
    [
        (2.0, 4, 1.0, 0, 0),
        (4.0, 4, 1.0, 0, 4),
        (4.0, 1, 1.0, 0, 0),
        (4.0, 4, 2.0, 0, 0),
        (4.0, 12, 1.0, 0, 0),
        (4.0, 4, 1.0, 3, 4),
        (4.0, 4, 1.0, 4, 0),
    ],
    ids=["little", "far more", "a jolt", "in another motion", "often", "a gap", "no gap"],
)
def test_what_stands_out_of_calm_half_seconds_of_the_same_motion(
    size: float, halves: int, fast: float, between: int, said: int
) -> None:
    """Of twenty half seconds, some in which the error is so many times the noise."""
    error, moved = np.ones(20), np.full(20, 3.0)
    error[:halves], moved[:halves], error[20 - between :] = size, 3.0 * fast, 2.0
    count = np.full(20, 50.0)
    assert _lasting(1.0, count * error**2, count * moved**2, count) == said


def test_half_seconds_of_few_samples_tell_nothing() -> None:
    count = np.array([50.0] * 10 + [10.0] * 4)
    error = np.array([1.0] * 10 + [9.0] * 4)
    assert _lasting(1.0, count * error**2, count, count) == 0


def test_nothing_is_said_of_a_machine_that_remembers() -> None:
    assert momentary(Mock(spec=Objective, forgets=False), Mock(spec=Assessed)) == {}
