"""An elastic element that yields is bent, when a replay begins, by the way that was gone before."""

from __future__ import annotations

import io
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import chain, world
from tests.physics.arm import ARM, motion, scene, simulate
from tests.physics.laws import play_operator
from wt.diagnose.report.handed_over import hand_over
from wt.diagnose.report.verify import replayed_files
from wt.diagnose.selection.holdout import errors, prepare_holdout
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.types import Location

AT = Location("joint", "j1")
YIELDS = Planted(effects()["joint.hysteresis"], AT, np.array([12.0, 1.2]))
LOADED = Planted(effects()["joint.friction_load"], AT, np.array([0.0, 0.0]))
"""A law that acts at every step, and does nothing."""


@pytest.mark.parametrize("beside", [(), (LOADED,)], ids=["rolled", "stepped"])
def test_a_replay_from_the_middle_begins_as_bent(
    tmp_path: Path, beside: tuple[Planted, ...]
) -> None:
    run, machine = simulate(ARM, play_operator()), scene(tmp_path)
    moved = motion(machine, run)
    starts = np.arange(600, 3200, 400)
    errors = []
    for known in ({"motion": moved, "segment": moved.segments[0]}, {}):
        stretches = [
            Stretch(0, run.t[k : k + 600], run.held[k : k + 600], run.q[k], run.v[k], **known)  # type: ignore[arg-type]
            for k in starts
        ]
        q = Replayer(machine, stretches).run([(YIELDS, *beside)]).q[0]
        true = np.concatenate([run.q[k : k + 600] for k in starts])
        errors.append(float(np.sqrt(np.mean((q - true) ** 2))))
    assert errors[0] < 1e-4
    assert errors[1] > 20.0 * errors[0]


def test_it_does_not_kick_where_nothing_is_known_of_before(tmp_path: Path) -> None:
    """It is unbent where the replay begins, and not where the model has its zero."""
    machine, resting = scene(tmp_path), np.array([0.0, 0.8, 0.0])
    t = 5e-4 * np.arange(40)
    stretch = Stretch(0, t, np.tile(resting, (40, 1)), resting, np.zeros(3))
    with_it, without = Replayer(machine, [stretch]).run([(YIELDS,), ()]).v
    # at first there is nothing but the weight
    np.testing.assert_allclose(with_it[:8], without[:8], atol=0.02 * np.abs(without[7]).max())


def test_written_files_begin_as_bent(tmp_path: Path) -> None:
    bend = {"z": 0.0, "q": 0.0}

    def play(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        q = float(data.qpos[0])
        bend["z"] = float(np.clip(bend["z"] + q - bend["q"], -0.1, 0.1)) if data.time else 0.0
        bend["q"] = q
        data.qfrc_applied[0] -= 8.0 * bend["z"]

    made = world(tmp_path, 1, play, 5.0)
    held = prepare_holdout(made.held.smoothed, False, window=1.0)
    found = (Planted(effects()["joint.hysteresis"], AT, np.array([8.0, 0.8])),)
    files = hand_over(held, found, (found, ["It yields."]), ("a.parquet", "b.parquet"), None)
    replays = replayed_files(files.contents, chain(1))
    left, given = (float(np.sqrt(np.nanmean(x**2))) for x in (replays.model, replays.before))
    assert left < 0.1 * given
    with np.load(io.BytesIO(files.holdout_npz)) as stored:
        assert stored["remembered"].tolist() == ["j1_hysteresis bend"]
        assert 0.05 < np.abs(stored["remembered_x"]).max() <= 0.1
    # replays of the search let their begin adapt
    assert np.sqrt(np.nanmean(errors(held, [found], 5e-4) ** 2)) < 1.2 * left
