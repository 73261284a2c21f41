"""A rotor behind a gear begins in balance, and takes its share of the joint's losses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import chain, record
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

AT = Location("joint", "j1")


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Stretch]:
    """A stretch of a servo that is commanded elsewhere than where its joint is."""
    path = tmp_path_factory.mktemp("rotor") / "chain.xml"
    path.write_text(chain(1))
    scene = Scene(path)
    smoothed = smooth(scene, [Part(record(chain(1), None, 4.0, 0), 0)])
    found = [s for s, _ in stretches_of(smoothed, False)]
    return scene, max(found, key=lambda s: abs(ahead(scene, s)))


def ahead(scene: Scene, stretch: Stretch) -> float:
    """How far the drive would turn a free rotor [rad]."""
    (drive,) = scene.drives
    force = drive.force(stretch.command[:1, 0], stretch.q0, stretch.v0)
    return float(force[0]) / (-drive.bias[1] * drive.gear**2)


def twist(scene: Scene, stretch: Stretch, effect: str, *theta: float) -> float:
    """How far its rotor begins ahead of the link [rad]."""
    found = effects()[effect].started(AT, np.array([*theta, 0.0]), stretch)
    assert set(found) == {"j1_rotor"} and found["j1_rotor"].velocity == stretch.v0[0]
    return found["j1_rotor"].position - float(stretch.q0[0])


def test_in_the_play_it_is_where_its_drive_holds_it(begun: tuple[Scene, Stretch]) -> None:
    free = ahead(*begun)
    assert twist(*begun, "joint.backlash", 4.0 * abs(free)) == pytest.approx(free)


def test_beyond_the_play_teeth_stop_it(begun: tuple[Scene, Stretch]) -> None:
    free = ahead(*begun)
    expected = np.copysign(0.25 * abs(free), free)
    assert twist(*begun, "joint.backlash", 0.5 * abs(free)) == pytest.approx(expected)


def test_an_elastic_gear_is_twisted_in_balance(begun: tuple[Scene, Stretch]) -> None:
    scene, stretch = begun
    (drive,) = scene.drives
    held = -drive.bias[1] * drive.gear**2
    found = twist(scene, stretch, "joint.elasticity", 3.0 * held, 0.0)
    assert found == pytest.approx(0.25 * ahead(scene, stretch))


def test_a_replay_begins_so(begun: tuple[Scene, Stretch]) -> None:
    """The link is not jolted: in the first instants it moves as without a gear."""
    scene, stretch = begun
    stiff = Planted(effects()["joint.elasticity"], AT, np.array([2000.0, 2.0, 0.0]))
    plain, geared = Replayer(scene, [stretch], 1e-3).run([(), (stiff,)]).q
    first = stretch.t <= stretch.t[0] + 0.05
    moved = np.ptp(plain[first])
    assert np.abs(geared - plain)[first].max() < 0.02 * moved


LOSSY = """\
<mujoco><compiler angle="radian"/><worldbody><body name="link"><joint name="j1" axis="0 1 0"
  armature="0.02" damping="0.4" frictionloss="0.1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/></body></worldbody>
  <actuator><motor name="m1" joint="j1"/></actuator></mujoco>
"""


@pytest.mark.parametrize(
    ("name", "theta"), [("joint.backlash", [0.04]), ("joint.elasticity", [150, 1])]
)
def test_losses_are_shared_by_rotor_and_link(name: str, theta: list[float]) -> None:
    spec = mujoco.MjSpec.from_string(LOSSY)
    effects()[name].patch(spec, AT, np.array([*theta, 0.75]))
    model = spec.compile()
    for joint, damping, friction in (("j1", 0.1, 0.025), ("j1_rotor", 0.3, 0.075)):
        dof = int(model.joint(joint).dofadr[0])
        assert model.dof_damping[dof] == pytest.approx(damping)
        assert model.dof_frictionloss[dof] == pytest.approx(friction)


def test_where_losses_are_is_tried_where_there_are_any(
    begun: tuple[Scene, Stretch], tmp_path: Path
) -> None:
    moved = begun[1].motion
    assert moved is not None
    path = tmp_path / "lossless.xml"
    path.write_text(chain(1).replace(' damping=".3"', ""))
    for scene, shares in ((begun[0], {0.0, 1.0}), (Scene(path), {0.0})):
        starts = effects()["joint.elasticity"].starts(replace(moved, scene=scene), AT)
        assert {float(s[-1]) for s in starts} == shares


@pytest.mark.parametrize("last", [0, 1])
def test_what_changes_losses_and_inertia_finds_them_where_the_split_put_them(last: int) -> None:
    spec = mujoco.MjSpec.from_string(chain(1))
    spec.joint("j1").armature = 0.02
    gear = Planted(effects()["joint.backlash"], AT, np.array([0.03, 0.9]))
    damping = Planted(effects()["joint.friction_viscous"], AT, np.array([-0.06]))  # of .3
    inertia = Planted(effects()["joint.armature"], AT, np.array([-0.005]))
    parts = [damping, inertia]
    parts.insert(2 * last, gear)
    for planted in parts:
        planted.effect.patch(spec, planted.at, planted.theta)
    link, rotor = spec.joint("j1"), spec.joint("j1_rotor")
    assert (link.armature, rotor.armature) == pytest.approx((0.0, 0.015))
    assert (link.damping[0], rotor.damping[0]) == pytest.approx((0.1 * 0.24, 0.9 * 0.24))
