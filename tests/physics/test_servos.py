"""What firmware of servos does and remembers, against closed forms and simulations by hand."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import ARM, H, Hook, edited, motion, scene, simulate
from tests.physics.laws import M1, slow
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.servos import Goal, as_pid, gain, integral, profiled, servos, slewed
from wt.types import Location

AT = Location("actuator", "m1")
KI = 40.0


def leaning(start: float) -> Hook:
    """Integral action of drive m1 that has come to ``start`` [rad·s] when the recording begins."""
    total = {"error": start}

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[1] += KI * total["error"]
        total["error"] += H * float(data.ctrl[1] - data.qpos[1])

    return hook


def planted(name: str, *theta: float) -> Planted:
    return Planted(effects()[name], AT, np.array(theta))


def from_middle(moved: Motion, at: float) -> Stretch:
    """What follows a moment of the only segment [s]."""
    first, segment = int(np.searchsorted(moved.t, at)), moved.segments[0]
    states = moved.q[first], moved.v[first]
    return Stretch(
        0, moved.t[first:], moved.command[first:], *states, segment=segment, motion=moved
    )


def test_a_profile_from_rest_to_rest_takes_its_time() -> None:
    """A trapezoid: way / speed + speed / acceleration; a triangle: 2 √(way / acceleration)."""
    for way, speed, took in (
        (0.5, 0.8, 0.5 / 0.8 + 0.8 / 4.0),
        (0.1, 0.8, 2.0 * (0.1 / 4.0) ** 0.5),
    ):
        path = profiled(np.full(2000, way), 1e-3, speed, 4.0, Goal(0.0))
        there = float(np.flatnonzero(np.abs(path[:, 0] - way) > 1e-6)[-1]) * 1e-3
        assert there == pytest.approx(took, abs=0.01)
        assert path[:, 0].max() < way + 1e-6
        assert np.abs(np.diff(path[:, 1], prepend=0.0)).max() <= 4.0 * 1e-3 + 1e-12


def test_a_goal_moves_as_that_of_a_pid(tmp_path: Path) -> None:
    spec = scene(tmp_path).spec()
    effects()["actuator.slew_rate"].patch(spec, AT, np.array([0.7]))
    model = spec.compile()
    data, u = mujoco.MjData(model), 0.2 * np.sin(np.arange(400) * 0.02)
    goals = []
    for command in u:
        data.ctrl[1] = command
        mujoco.mj_step(model, data)
        goals.append(data.act[0])
    np.testing.assert_allclose(goals, slewed(u, model.opt.timestep, 0.7, 0.0), atol=1e-12)


def test_a_pid_without_more_is_the_servo_that_it_was(tmp_path: Path) -> None:
    servo = '<position name="m1" joint="j1" kp="60" dampratio="1" gear="2"'
    ranges = 'ctrlrange="-.2 .2" forcerange="-5 5"'
    text = edited((f'<general name="m1" joint="j1" {M1}', f"{servo} {ranges}"))
    of = scene(tmp_path, text)
    before, spec = of.spec().compile(), of.spec()
    as_pid(spec, "m1").gainprm[0] = 1e-12  # a pid is one with a state
    after = spec.compile()
    for q, v, u in ((0.1, 0.5, 0.15), (-0.2, 0.3, 0.9), (0.0, -2.0, 0.0)):
        forces = []
        for model in (before, after):
            data = mujoco.MjData(model)
            data.joint("j1").qpos, data.joint("j1").qvel, data.ctrl[1] = q, v, u
            mujoco.mj_forward(model, data)
            forces.append(float(data.actuator("m1").force[0]))
        assert forces[0] == pytest.approx(forces[1], rel=1e-12)


@pytest.mark.parametrize(
    ("drive", "is_one"),
    [
        (M1, True),
        ('gainprm="120" biastype="affine" biasprm="0 -60 -3"', False),
        (f'dyntype="filterexact" dynprm="0.02" {M1}', False),
        ('gainprm="60"', False),
    ],
    ids=["servo", "half a gear", "filtered", "motor"],
)
def test_where_firmware_may_be_one_of_a_servo(drive: str, is_one: bool, tmp_path: Path) -> None:
    assert (AT in servos(scene(tmp_path, edited((M1, drive))))) == is_one


@pytest.mark.parametrize("start", [0.0, -0.12], ids=["switched on", "settled"])
def test_forces_say_what_an_integral_had_come_to(start: float, tmp_path: Path) -> None:
    moved = motion(scene(tmp_path), simulate(ARM, leaning(start)))
    assert gain(moved, "m1") == pytest.approx(KI, rel=0.02)
    assert integral(moved, "m1", KI)[0] == pytest.approx(start, abs=0.003)
    assert effects()["actuator.integral"].plausible(moved, AT, np.array([KI]))


def test_a_bias_is_no_integral(tmp_path: Path) -> None:
    def biased(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[1] += 3.0

    moved = motion(scene(tmp_path), simulate(ARM, biased))
    assert not effects()["actuator.integral"].plausible(moved, AT, np.array([0.05]))


def test_a_replay_from_the_middle_remembers_what_was(tmp_path: Path) -> None:
    of = scene(tmp_path)
    cases = (
        (leaning(-0.1), planted("actuator.integral", KI)),
        (slow(0.8), planted("actuator.slew_rate", 0.8)),
    )
    for hook, law in cases:
        moved = motion(of, simulate(ARM, hook))
        stretch = from_middle(moved, 0.9)
        replays = Replayer(of, [stretch]).run([[], [law]])
        first = len(moved) - len(stretch.t)
        error = np.sqrt(np.mean((replays.q - moved.q[first:]) ** 2, axis=(1, 2)))
        assert error[1] < 0.02 * error[0]


def test_gain_and_integral_may_be_patched_in_any_order(tmp_path: Path) -> None:
    both = planted("actuator.gain", 0.8), planted("actuator.integral", KI)
    models = []
    for order in (both, both[::-1]):
        spec = scene(tmp_path).spec()
        for law in order:
            law.effect.patch(spec, law.at, law.theta)
        models.append(spec.compile())
    for name in ("actuator_gainprm", "actuator_biasprm", "actuator_dynprm"):
        np.testing.assert_array_equal(*(getattr(m, name) for m in models))
