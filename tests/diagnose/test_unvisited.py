"""What is left on held-out data is said to be from where no fitted recording was, if it is."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import RATE, chain, record
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.selection.holdout import Holdout, errors, prepare_holdout
from wt.diagnose.unvisited import unvisited
from wt.physics.scene import Scene

BLOCKED = 0.9  # rad, from which on a cable pulls


def cable(_: mujoco.MjModel, data: mujoco.MjData) -> None:
    """It is taut beyond."""
    data.qfrc_applied[0] = -20.0 * max(0.0, float(data.qpos[0]) - BLOCKED)


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> tuple[Smoothed, Smoothed]:
    """A calm recording, and one that goes where the cable is taut."""
    path = tmp_path_factory.mktemp("unvisited") / "chain.xml"
    path.write_text(chain(2))
    scene = Scene(path)
    made = [record(chain(2), cable, 6.0, seed, swing) for seed, swing in ((0, 0.1), (1, 0.35))]
    fit, held = (smooth(scene, [Part(r, i)]) for i, r in enumerate(made))
    assert fit.motion.q[:, 0].max() < BLOCKED < held.motion.q[:, 0].max() - 0.1
    return fit, held


def left(held: Holdout) -> np.ndarray:
    return errors(held, [()], 5e-4)[0]


def test_where_no_fitted_recording_was_is_said(seen: tuple[Smoothed, Smoothed]) -> None:
    fit, other = seen
    held = prepare_holdout(other, True)
    found = unvisited(fit, held, left(held))
    assert found is not None and (found.joint, found.above) == ("j1", True)
    assert fit.motion.q[:, 0].max() < found.end < BLOCKED
    q = held.measured[:, 0]
    assert found.seconds == pytest.approx(np.sum(q > found.end) / RATE, rel=0.02)
    assert found.share > 0.9 and found.outside > 3.0 * found.inside
    said = found.sentence(fit.motion.scene)
    assert "j1" in said and "no fitted recording" in said and "°" in said


def test_nothing_is_said_of_what_was_fitted(seen: tuple[Smoothed, Smoothed]) -> None:
    fit, other = seen
    held = prepare_holdout(other, True)
    assert unvisited(other, held, left(held)) is None  # fitted recordings go there
    same = prepare_holdout(fit, True)
    assert unvisited(other, same, left(same)) is None  # held-out ones do not
    # nor where nothing but noise is left
    noise = np.random.default_rng(0).normal(size=held.measured.shape) * other.noise
    assert unvisited(fit, held, noise) is None


def test_nor_where_a_joint_errs_as_much_everywhere(
    seen: tuple[Smoothed, Smoothed], tmp_path: Path
) -> None:
    fit, other = seen
    held = prepare_holdout(other, True)
    assert unvisited(fit, held, np.full(held.measured.shape, 0.05)) is None
