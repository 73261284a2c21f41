"""What is written for the user is the machine: MJCF, and plain numpy for what MJCF cannot say."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.mjcf.written import drive, error, load, module, planted, unhidden, write
from tests.physics.arm import ARM, H, commands, scene, simulate
from tests.physics.truths import TRUTHS, Truth
from wt.mjcf.physics import physics_py
from wt.physics.effect import effects
from wt.physics.hooks import shaped
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.types import Location


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: f"{t.id}-{t.at.name}")
def test_files_are_the_machine_in_plain_mujoco(truth: Truth, tmp_path: Path) -> None:
    run, before = truth.machine(), unhidden(truth.model)
    influence = error(before.q, run)
    model, physics = load(write(tmp_path, [planted(truth)], truth.model))
    effect = effects()[truth.id]
    assert effect.native == (physics is None), "MJCF says it all, or physics.py says the rest"
    files = error(drive(model, physics, run), run)
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    replay = Replayer(scene(tmp_path, truth.model), [stretch]).run([[planted(truth)]])
    own = error(replay.q[0], run)
    assert files < truth.replays * influence
    # what is handed over is what was searched with
    assert files < 1.2 * own + 0.01 * influence


@pytest.mark.parametrize(
    "law", [("joint.friction_load", 0.3, 0.2), ("joint.gear_loss", 0.1, 0.35, 0.3, 0.2)]
)
def test_shares_of_a_drive_that_was_found_strong_are_as_in_replays(
    law: tuple[str, *tuple[float, ...]], tmp_path: Path
) -> None:
    name, *theta = law
    hypothesis = [
        Planted(effects()["actuator.gain"], Location("actuator", "m1"), np.array([1.5])),
        Planted(effects()[name], Location("joint", "j1"), np.array(theta)),
    ]
    run = unhidden(ARM)
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    replays = Replayer(scene(tmp_path, ARM), [stretch]).run([hypothesis, hypothesis[:1]]).q
    files = drive(*load(write(tmp_path, hypothesis)), run)
    friction = np.sqrt(np.mean((replays[0] - replays[1]) ** 2))
    assert np.sqrt(np.mean((files - replays[0]) ** 2)) < 0.02 * friction


SHORT_S = 0.5
"""Of what is the same to the bit, or nearly so, from the first step on."""
NOT_NATIVE = [t for t in TRUTHS if not effects()[t.id].native]
WRITTEN = pytest.mark.parametrize("truth", NOT_NATIVE, ids=lambda t: t.id)


@WRITTEN
def test_physics_is_short_plain_and_one_class(truth: Truth, tmp_path: Path) -> None:
    text = (write(tmp_path, [planted(truth)]) / "physics.py").read_text()
    assert len(text.splitlines()) < 200
    assert max(map(len, text.splitlines())) <= 100
    assert "wt." not in text and "# <" not in text
    tree = ast.parse(text)
    classes = [n.name for n in tree.body if isinstance(n, ast.ClassDef)]
    assert classes == ["Physics"]
    imports = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    imports |= {str(n.module) for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert imports <= {"numpy", "mujoco", "__future__", "collections.abc"}
    said = planted(truth).statement(scene(tmp_path, ARM))
    assert said.split(" by")[0][:40] in " ".join(text.replace("#", "").split())


EVERY = [
    Planted(effects()["actuator.deadband"], Location("actuator", "m0"), np.array([0.2])),
    Planted(effects()["actuator.speed_limit"], Location("actuator", "m1"), np.array([8.0, 3.0])),
    Planted(effects()["joint.friction_load"], Location("joint", "j1"), np.array([0.3, 0.2])),
    Planted(effects()["actuator.fade"], Location("actuator", "m2"), np.array([0.4, 2.0])),
    Planted(effects()["joint.elasticity"], Location("joint", "j2"), np.array([150.0, 0.5, 0.5])),
    Planted(effects()["actuator.delay"], Location("actuator", "m1"), np.array([0.0123])),
    Planted(effects()["actuator.lag"], Location("actuator", "m0"), np.array([0.02])),
    Planted(
        shaped(effects()["body.force_intermittent"], (0.0, 0.3, 0.6, 1.0, 0.1, 0.2)),
        Location("body", "b2"),
        np.array([3.0, -2.0, 4.0]),
    ),
    Planted(effects()["sensor.offset"], Location("joint", "j1"), np.array([0.02])),
    Planted(effects()["sensor.scale"], Location("joint", "j0"), np.array([1.1])),
    Planted(effects()["sensor.delay"], Location("sensor", "all"), np.array([0.004])),
]


@pytest.mark.parametrize(("count", "most"), [(4, 200), (len(EVERY), 270)])
def test_many_effects_are_still_short(count: int, most: int, tmp_path: Path) -> None:
    text = (write(tmp_path, EVERY[:count]) / "physics.py").read_text()
    assert max(map(len, text.splitlines())) <= 100
    assert len(text.splitlines()) < most


def test_callbacks_and_steps_are_the_same(tmp_path: Path) -> None:
    folder, run = write(tmp_path, EVERY), unhidden(ARM, SHORT_S)
    one = drive(*load(folder), run)
    other = drive(*load(folder), run, attached=True)
    assert error(one, run) > 1e-3
    np.testing.assert_array_equal(one, other)


def test_after_a_reset_the_same_happens_again(tmp_path: Path) -> None:
    run = unhidden(ARM, SHORT_S)
    model, physics = load(write(tmp_path, EVERY))
    one = drive(model, physics, run)
    np.testing.assert_array_equal(one, drive(model, physics, run))
    assert mujoco.get_mjcb_passive() is None


def test_many_simulations_at_once_are_many_alone(tmp_path: Path) -> None:
    """``forces`` of a batch, one of which begins anew, is what each would have had by itself."""
    folder = write(tmp_path, EVERY[:4])
    rng = np.random.default_rng(0)
    model, physics = load(folder)
    assert physics is not None
    alone = [load(folder)[1] for _ in range(3)]
    times = np.stack([np.arange(60) * H, np.arange(60) * H, (np.arange(60) % 25) * H])
    for t in times.T:
        q, v, u = rng.normal(size=(3, 3, model.nq))
        found = physics.forces(q, v, u, t)
        for i, one in enumerate(alone):
            assert one is not None
            again = one.forces(q[[i]], v[[i]], u[[i]], t[[i]])[0]
            np.testing.assert_allclose(found[i], again, rtol=1e-12, atol=1e-12)
        # asked twice at the same time, nothing has moved on
        np.testing.assert_allclose(physics.forces(q, v, u, t), found, rtol=1e-12, atol=1e-12)
    assert np.abs(found).max() > 0.1


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_integrators_agree(integrator: str, tmp_path: Path) -> None:
    """Heat and bristles move on once a step, also where a step has four stages."""
    xml = ARM.replace("<option ", f'<option integrator="{integrator}" ')
    model, physics = load(write(tmp_path, EVERY[:4], xml))
    plain, exact = load(write(tmp_path, EVERY[:4]))
    run = unhidden(ARM, SHORT_S)
    euler = drive(plain, exact, run)
    moved = np.sqrt(np.mean((euler - run.q) ** 2))
    assert np.sqrt(np.mean((drive(model, physics, run) - euler) ** 2)) < 0.02 * moved


def test_a_rotor_starts_in_balance(tmp_path: Path) -> None:
    """A joint that is held under load does not move when the simulation begins."""
    hypothesis = [EVERY[4], EVERY[0]]
    model, physics = load(write(tmp_path, hypothesis))
    assert physics is not None
    data = mujoco.MjData(model)
    data.joint("j2").qpos, data.ctrl[:] = 0.4, (0.0, 0.0, 0.5)
    physics.reset(data)
    twist = data.joint("j2_rotor").qpos[0] - 0.4
    assert 150.0 * twist == pytest.approx(30.0 * (0.5 - 0.4 - twist), rel=1e-3)
    mujoco.mj_forward(model, data)
    assert abs(data.joint("j2_rotor").qacc[0]) < 1e-3


def test_runs_where_nothing_of_ours_is(tmp_path: Path) -> None:
    folder = write(tmp_path, EVERY)
    code = (
        "import sys; sys.path.insert(0, '.'); import mujoco; from physics import Physics\n"
        "model = mujoco.MjModel.from_xml_path('model.xml'); data = mujoco.MjData(model)\n"
        "p = Physics(model); p.reset(data)\n"
        "for _ in range(100): data.ctrl[:] = 0.3; p.step(data)\n"
        "assert not any(name.split('.')[0] == 'wt' for name in sys.modules), 'ours'\n"
        "print(float(data.qpos[1]))"
    )
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-I", "-c", code], cwd=folder, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert abs(float(done.stdout)) > 1e-4


def test_commands_are_those_of_the_machine() -> None:
    """The loop above drives as the truths do."""
    t, held = commands(0.1)
    run = simulate(ARM, seconds=0.1)
    np.testing.assert_array_equal(run.t, t)
    np.testing.assert_array_equal(run.held, held)


def test_events_have_their_times_in_each_recording(tmp_path: Path) -> None:
    pushes = Planted(
        shaped(effects()["body.force_intermittent"], (0.0, 0.3, 0.6, 1.0, 0.1, 0.2)),
        Location("body", "b2"),
        np.array([3.0, -2.0, 4.0]),
    )
    of = scene(tmp_path)
    path = tmp_path / "physics.py"
    path.write_text(str(physics_py(of, (pushes,), ("a.parquet", "b.parquet"), 1)))
    physics = module(path).Physics(of.model)
    assert physics.recordings == ("a.parquet", "b.parquet")
    at = np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.array([0.15, 0.45])
    jacobian, data = np.zeros((3, 3)), mujoco.MjData(of.model)
    mujoco.mj_forward(of.model, data)
    mujoco.mj_jacBodyCom(of.model, data, jacobian, None, of.model.body("b2").id)
    pushed = np.array([3.0, -2.0, 4.0]) @ jacobian
    for recording, row in ((1, 0), (0, 1)):
        assert recording == 0 or physics.recording == 1
        physics.recording = recording
        found = physics.forces(*at)
        np.testing.assert_allclose(found[row], pushed, atol=1e-9)
        np.testing.assert_array_equal(found[1 - row], 0.0)
