"""States are read again beside the response of the machine as it was found; then what is faint."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from wt.diagnose import pipeline
from wt.diagnose.pace import Pace
from wt.diagnose.pipeline import audited, diagnose
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.naming import Naming
from wt.diagnose.split import Split, split_of, steps_for
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location, Recording

RATE, SECONDS, STEP, NOISE = 25, 8.0, 2e-4, 1e-4
ROTOR, DRY = 0.04, 0.02  # kg·m², N·m: as much inertia again, and ten times less than any servo's
GIVEN = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody>
  <body><joint name="a" axis="0 1 0" damping=".2" armature=".1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1.2" contype="0"/>
    <body pos="0 0 -.4"><joint name="b" axis="0 1 0" damping=".2" armature=".04"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass=".8" contype="0"/></body>
  </body></worldbody><actuator><position name="a" joint="a" kp="90" kv="5"/>
  <position name="b" joint="b" kp="60" kv="3"/></actuator></mujoco>"""
TRUE = GIVEN.replace('armature=".04"', f'armature="{0.04 + ROTOR}" frictionloss="{DRY}"')


LATE = 0.03  # s
TARDY = GIVEN.replace('kp="', f'delay="{LATE}" nsample="152" interp="linear" kp="')


def recorded(seed: int, true: str = TRUE) -> Recording:
    """An arm that is steered in steps and waves, logged as seldom as it is steered."""
    model = mujoco.MjModel.from_xml_string(true)
    model.opt.timestep = STEP
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    t = np.arange(round(SECONDS * RATE)) / RATE
    rate, phase = rng.uniform(0.15, 1.0, (4, 2)), rng.uniform(0.0, 6.28, (4, 2))
    u = (0.18 * np.sin(2.0 * np.pi * t[:, None, None] * rate + phase)).sum(axis=1)
    u = (u + 0.3 * (np.floor(t / 1.7) % 2)[:, None]) * np.minimum(t, 1.0)[:, None]
    q = np.empty_like(u)
    for k, data.ctrl[:] in enumerate(u):
        q[k] = data.qpos
        mujoco.mj_step(model, data, round(1.0 / (RATE * STEP)))
    q += NOISE * rng.standard_normal(q.shape)
    columns = {f"qpos/{j}": q[:, i] for i, j in enumerate("ab")}
    return Recording(t, columns | {f"ctrl/{j}": u[:, i] for i, j in enumerate("ab")})


@pytest.fixture
def model(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text(GIVEN)
    return tmp_path / "arm.xml"


def test_a_rotor_that_is_found_leaves_the_encoders_noise_in_all_recordings(model: Path) -> None:
    scene, prepared = audited(model, [recorded(0), recorded(1)], (), Pace(None, None))
    split = split_of(scene, prepared, 0, DecisionLog(), Pace(None, None))
    at = Location("joint", "b")
    found = split.beside((Planted(effects()["joint.armature"], at, np.array([ROTOR])),))
    for given, now in ((split.fitted, found.fitted), (split.held_out, found.held_out)):
        assert given.noise[1] > 2.0 * NOISE
        assert now.noise == pytest.approx([NOISE, NOISE], rel=0.2)
    assert found.screen is split.screen
    assert found.whole().noise == pytest.approx([NOISE, NOISE], rel=0.2)
    rubs = Planted(effects()["joint.friction_coulomb"], at, np.array([DRY]))
    assert split.beside((rubs,)) is split


def test_commands_that_are_found_to_be_late_leave_the_encoders_noise(model: Path) -> None:
    both = [recorded(seed, TARDY) for seed in (0, 1)]
    scene, prepared = audited(model, both, (), Pace(None, None))
    split = split_of(scene, prepared, 0, DecisionLog(), Pace(None, None))
    every = Location("actuator", "all")
    found = split.beside((Planted(effects()["actuator.delay"], every, np.array([LATE])),))
    for given, now in ((split.fitted, found.fitted), (split.held_out, found.held_out)):
        assert given.noise[1] > 2.0 * NOISE
        assert now.noise == pytest.approx([NOISE, NOISE], rel=0.2)


def test_friction_that_a_wrong_inertia_hid_is_found_beside_it(model: Path) -> None:
    found = diagnose(model, [recorded(0), recorded(1)])
    sizes = {f.effect: [e.value for e in f.parameters.values()] for f in found.findings}
    assert found.verdict == "explained"
    assert set(sizes) == {"joint.armature", "joint.friction_coulomb"}
    assert sizes["joint.armature"] == pytest.approx([ROTOR], rel=0.1)
    assert sizes["joint.friction_coulomb"] == pytest.approx([DRY], rel=0.2)


@pytest.mark.parametrize("moved", [True, False])
def test_the_search_goes_on_only_where_states_move(
    moved: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    was = (Mock(spec=Accepted, planted=Mock(spec=Planted)),)
    more = (*was, Mock(spec=Accepted))
    search = Mock(return_value=more)
    monkeypatch.setattr(pipeline, "search", search)
    naming, later = Mock(spec=Naming), Mock(spec=Naming, search_replays=Mock(), log=Mock())
    split = Mock(spec=Split)
    again = Mock(spec=Split, screen=Mock()) if moved else split
    again.naming.return_value = later
    split.beside.return_value = again
    said = pipeline._read_again(split, naming, was, 1.0, Mock(spec=Pace))
    assert said == ((again, later, more) if moved else (split, naming, was))
    split.beside.assert_called_once_with((was[0].planted,))
    assert search.called == moved
    if moved:
        assert search.call_args.args[1] is later.search_replays
        assert search.call_args.args[4] is was, "what was found is not looked for again"


TIGHT = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody>
  <body><joint name="a" axis="0 1 0" damping=".2" armature=".01"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1.2" contype="0"/></body>
  </worldbody><actuator><position name="a" joint="a" kp="400" kv="12"/></actuator></mujoco>"""


def servo(jump: float, seed: int) -> Recording:
    """A tight servo that follows a wave exactly as modelled, beside jumps of so many rad."""
    model = mujoco.MjModel.from_xml_string(TIGHT)
    model.opt.timestep = 1e-4
    data, t = mujoco.MjData(model), np.arange(1200) / 100
    u = np.sin(t) * np.minimum(t, 1.0) + jump * (np.floor(t / 0.9) % 2)
    q = np.empty_like(u)
    for k, data.ctrl[0] in enumerate(u):
        q[k] = data.qpos[0]
        mujoco.mj_step(model, data, 100)
    q += NOISE * np.random.default_rng(seed).standard_normal(len(q))
    return Recording(t, {"qpos/a": q, "ctrl/a": u})


def test_steps_do_for_held_out_motions_too(tmp_path: Path) -> None:
    path = tmp_path / "servo.xml"
    path.write_text(TIGHT)
    scene, prepared = audited(path, [servo(0.0, 0)], [servo(0.4, 1)], Pace(None, None))
    split = split_of(scene, prepared, 0, DecisionLog(), Pace(None, None))
    smooth, jumping = (steps_for([recorded], None) for recorded in (split.fitted, split.held_out))
    both = split.steps(None)
    assert smooth and jumping and both
    assert jumping.fine < smooth.fine
    assert both.fine == jumping.fine
    assert both.coarse == min(smooth.coarse, jumping.coarse)
