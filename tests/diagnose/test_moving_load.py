"""A load that moves in a machine that nothing holds: found, and replayed from where it was."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics import stool
from wt.diagnose.likelihood.adapt import hidden, responses
from wt.diagnose.likelihood.tolerances import boxes, tolerances
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.residual.screen import Scored, Screen
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

MASS, TRAVEL = 1.5, 0.12
AT = (0.03, 0.0, 0.06)


def on_rails(spec: mujoco.MjSpec) -> None:
    load = spec.body("trunk").add_body(pos=AT)
    load.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=MASS, contype=0, conaffinity=0
    )
    load.add_joint(
        name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0], damping=[3 * MASS, 0, 0],
        limited=True, range=[-TRAVEL / 2, TRAVEL / 2], solref_limit=[0.006, 0.6],
    )  # fmt: skip


@pytest.fixture(scope="module")
def smoothed(tmp_path_factory: pytest.TempPathFactory) -> Smoothed:
    machine = stool.scene(tmp_path_factory.mktemp("stool"))
    return smooth(machine, [Part(stool.recording(5, on_rails, seconds=8.0), 0)])


@pytest.fixture(scope="module")
def moving(smoothed: Smoothed) -> Planted:
    """The load on the trunk, as the screen has it where it looks for nothing else."""
    at = Location("body", "trunk")
    (only,) = Screen(smoothed).rank([], {("body.payload_moving", at)})
    return read_off(smoothed, only)


def read_off(smoothed: Smoothed, best: Scored) -> Planted:
    at = best.planted.at
    (theta,) = best.planted.effect.starts(smoothed.motion, at)
    return Planted(best.planted.effect, at, theta)


@pytest.mark.long
def test_it_leads_and_its_figures_are_read_off(smoothed: Smoothed) -> None:
    best = Screen(smoothed).rank([])[0]
    assert (best.planted.effect.id, best.planted.at.name) == ("body.payload_moving", "trunk")
    mass, travel, *at = read_off(smoothed, best).theta
    assert mass == pytest.approx(MASS, rel=0.25)
    assert travel == pytest.approx(TRAVEL, rel=0.25)
    assert at == pytest.approx(AT, abs=0.06)


def test_replays_start_with_the_load_where_it_was(smoothed: Smoothed, moving: Planted) -> None:
    pieces = stretches_of(smoothed, False)
    fixed = Planted(effects()["body.payload_fixed"], moving.at, np.array([MASS, *AT]))
    measured = np.concatenate([q for _, q in pieces])
    replayer = Replayer(smoothed.motion.scene, [s for s, _ in pieces], 1e-3)
    error = replayer.run([(), (fixed,), (moving,)]).q - measured
    nothing, still, rolling = np.sqrt(np.nanmean(error**2, axis=(1, 2)))
    assert rolling < 0.85 * still < nothing


def test_where_it_was_may_adapt(smoothed: Smoothed, moving: Planted) -> None:
    some = [s for s, _ in stretches_of(smoothed, False)][:2]
    nv = smoothed.motion.scene.model.nv
    assert list(hidden([moving], some[0])) == ["trunk_payload_x"]
    replayer = Replayer(smoothed.motion.scene, some, 1e-3)
    found = responses(replayer, [moving])
    assert found.shape[2] == 2 * nv + 2
    assert np.abs(found[:, :, -2:]).max() > 1e-4
    assert responses(replayer, []).shape[2] == 2 * nv


def test_its_weight_is_no_error_of_the_trunk(tmp_path: Path) -> None:
    machine: Scene = stool.scene(tmp_path)
    effect = effects()["body.payload_moving"]
    (trunk,) = [at for at in effect.places(machine) if at.name == "trunk"]
    some = tolerances(machine)
    beside = boxes(some, [Planted(effect, trunk, np.zeros(5))])
    held = [str(n.planted) for n, size in zip(some, beside, strict=True) if size == 0.0]
    assert held == ["body.mass at body trunk"]
    assert boxes(some, []).min() > 0.0
