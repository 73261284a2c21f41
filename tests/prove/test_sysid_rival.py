"""The rival finds what is hidden when it is told where to look, and is judged as we are."""

from __future__ import annotations

import types
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.errors import ConfigError, WorkError
from wt.prove import sysid_rival
from wt.prove.cases import Case, HiddenEffect
from wt.prove.rigs import RIGS, nominal_xml
from wt.prove.sensing import Sensing
from wt.prove.sysid_rival import Rival, every_parameter
from wt.prove.world import HiddenWorld, build
from wt.types import Recording

COULOMB = 0.6  # N·m, by a law of the hidden worlds, which share no code with what is fitted
FRICTION = ("joint.friction_coulomb", "hinge")
SENSING = Sensing(200.0, bits=16, noise=1e-4, qvel="none", drops=0.01, missing="nan", gyro=True)


@pytest.fixture(scope="module")
def world() -> HiddenWorld:
    truth = HiddenEffect(FRICTION[0], "joint", "hinge", {"coulomb": COULOMB}, FRICTION[0])
    motions = ("multisine", "triangle", "chirp")
    return build(Case("friction", "pendulum", 3, "single", (truth,), SENSING, motions, 4.0))


@pytest.fixture(scope="module")
def rival(world: HiddenWorld, tmp_path_factory: pytest.TempPathFactory) -> Rival:
    model = tmp_path_factory.mktemp("rival") / "robot.xml"
    model.write_text(world.nominal_xml)
    return Rival(model, world.fit)


def test_hidden_friction_is_recovered(rival: Rival, world: HiddenWorld) -> None:
    fitted = rival.fit([FRICTION])
    assert fitted.theta[FRICTION] == pytest.approx([COULOMB], rel=0.03)
    assert fitted.seconds > 0.0
    error = rival.prove(fitted, world.holdout).holdout
    # the hidden rod's mass is a few per cent off, which friction cannot make up for
    assert error.after < 0.25 * error.before
    model = mujoco.MjModel.from_xml_string(fitted.xml)
    assert model.dof_frictionloss[0] == pytest.approx(COULOMB, rel=0.03)


def test_its_own_options_end_at_the_same_place(rival: Rival) -> None:
    own, tuned = rival.fit([FRICTION], options={}), rival.fit([FRICTION])
    assert own.theta[FRICTION] == pytest.approx(tuned.theta[FRICTION], rel=2e-3)


def test_what_is_hidden_explains_more_than_something_else(rival: Rival) -> None:
    right, wrong = rival.fit([FRICTION]), rival.fit([("joint.armature", "hinge")])
    assert right.bic < wrong.bic - 100.0
    assert right.squares.sum() < 0.1 * wrong.squares.sum()


def test_nothing_free_is_the_model_as_it_is(rival: Rival) -> None:
    nothing = rival.fit([])
    assert nothing.theta == {}
    assert nothing.xml.replace("\n", "") == rival.scene.path.read_text().replace("\n", "")
    assert rival.fit([FRICTION]).bic < nothing.bic - 100.0


def test_every_parameter_contains_the_right_one(rival: Rival) -> None:
    free = every_parameter(rival.scene)
    assert {at for _, at in free} == {"hinge", "hinge_drive"}
    assert len(free) == 4
    fitted = rival.fit(free)
    assert fitted.theta[FRICTION] == pytest.approx([COULOMB], rel=0.1)
    assert fitted.jacobian.shape[1] == 4


def test_other_starts_are_seeded_and_do_no_harm(rival: Rival) -> None:
    once, twice = rival.fit([FRICTION]), rival.fit([FRICTION], seed=1, starts=2)
    assert twice.squares.sum() <= once.squares.sum() * (1.0 + 1e-6)
    assert rival.fit([FRICTION], seed=1, starts=2).theta == twice.theta


def test_it_stops_when_its_time_is_up(rival: Rival) -> None:
    free = every_parameter(rival.scene)
    short, long = rival.fit(free, starts=3, seconds=1e-3), rival.fit(free)
    # one step from the model as it is: better than that, and not yet at the end
    assert short.seconds < long.seconds
    assert long.squares.sum() < short.squares.sum() < rival.fit([]).squares.sum()


def test_what_the_model_has_too_much_of_is_taken_away(tmp_path: Path) -> None:
    """Truth is a plain loop of MuJoCo's, at a tenth of the step: nothing else is off."""
    own, true = RIGS["pendulum"].links[0].damping, 0.02
    xml = nominal_xml(RIGS["pendulum"])
    model = tmp_path / "robot.xml"
    model.write_text(xml)
    free = ("joint.friction_viscous", "hinge")
    fitted = Rival(model, [_simulated(xml, damping=true)]).fit([free])
    assert fitted.theta[free] == pytest.approx([true - own], abs=2e-3)


def test_what_cannot_be_fitted_is_said(rival: Rival) -> None:
    with pytest.raises(ConfigError, match=r"joint.friction_coloumb.*joint.friction_coulomb"):
        rival.fit([("joint.friction_coloumb", "hinge")])
    with pytest.raises(ConfigError, match=r"no place 'hing'.*hinge"):
        rival.fit([("joint.armature", "hing")])
    with pytest.raises(ConfigError, match="twice"):
        rival.fit([FRICTION, FRICTION])


def test_missing_packages_are_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sysid_rival.importlib, "import_module", types.ModuleType)
    with pytest.raises(WorkError, match=r"pip install '\.\[rivals\]'"):
        Rival(tmp_path / "robot.xml", [])


def _simulated(xml: str, damping: float) -> Recording:
    """Five seconds at 100 Hz, from rest at the first command."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.dof_damping[0], model.opt.timestep = damping, 5e-5
    data = mujoco.MjData(model)
    t = 0.01 * np.arange(500)
    u = 0.4 + 0.5 * np.sin(4.0 * t) + 0.2 * np.sin(13.0 * t)
    u -= u[0] - 0.4
    data.qpos[:], data.ctrl[:] = 0.4, 0.4
    mujoco.mj_step(model, data, 40000)
    q = []
    for command in u:
        q.append(float(data.qpos[0]))
        data.ctrl[:] = command
        mujoco.mj_step(model, data, 200)
    return Recording(t, {"ctrl/hinge_drive": u, "qpos/hinge": np.array(q)})
