"""Effects of sensors, and forces that come and go, against closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import ARM, Run, coefficients, motion, scene, simulate
from wt.physics.effect import effects
from wt.physics.effects.body_force_intermittent import BodyForceIntermittent
from wt.physics.planted import Planted
from wt.physics.replay import Outputs, Stretch
from wt.physics.rollout import Replayer
from wt.types import Location

J1 = Location("joint", "j1")


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(ARM)


def recorded(run: Run, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Run:
    """A recording whose joint j1 says something else."""
    changed = {"q": run.q.copy(), "v": run.v.copy(), "a": run.a.copy()}
    for name, value in (("q", q), ("v", v), ("a", a)):
        changed[name][:, 1] = value
    return replace(run, **changed)


@pytest.mark.parametrize(
    ("name", "theta", "shape"),
    [("sensor.offset", 0.02, ()), ("sensor.scale", 1.03, ()), ("sensor.delay", 0.004, (0.004,))],
)
def test_signature_of_a_sensor(
    name: str, theta: float, shape: tuple[float, ...], run: Run, tmp_path: Path
) -> None:
    q, v, a = run.q[:, 1], run.v[:, 1], run.a[:, 1]
    if name == "sensor.offset":
        wrong = recorded(run, q + theta, v, a)
    elif name == "sensor.scale":
        wrong = recorded(run, theta * q, theta * v, theta * a)
    else:
        late = (np.interp(run.t - theta, run.t, x) for x in (q, v, a))
        wrong = recorded(run, *late)
    moved = motion(scene(tmp_path), wrong)
    effect = effects()[name]
    found, left = coefficients(moved, effect.columns(moved, J1, shape))
    neutral = 1.0 if name == "sensor.scale" else 0.0
    assert effect.theta(found, shape)[0] - neutral == pytest.approx(theta - neutral, rel=0.06)
    assert left < 0.25


def test_what_sensors_report(run: Run, tmp_path: Path) -> None:
    arm = scene(tmp_path)

    def sensed(name: str, theta: float, at: Location = J1) -> Outputs:
        outputs = Outputs(0, run.t, run.q.copy(), run.v.copy())
        effects()[name].sense(outputs, arm, at, np.array([theta]))
        return outputs

    assert sensed("sensor.offset", 0.1).q[:, 1] == pytest.approx(run.q[:, 1] + 0.1)
    assert sensed("sensor.scale", 1.1).v[:, 1] == pytest.approx(1.1 * run.v[:, 1])
    late = sensed("sensor.delay", 0.01, Location("sensor", "all"))
    assert late.q[20:] == pytest.approx(run.q[:-20], abs=1e-9)
    steps = sensed("sensor.quantization", 0.01).q[:, 1] / 0.01
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert np.abs(0.01 * steps - run.q[:, 1]).max() <= 0.005 + 1e-12
    assert sensed("sensor.offset", 0.1).q[:, [0, 2]] == pytest.approx(run.q[:, [0, 2]])


def pushed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    if 0.8 <= data.time < 1.1:
        data.xfrc_applied[model.body("b2").id, :3] += (6.0, 2.0, -5.0)


def test_windows_of_a_push_are_found_and_replayed(tmp_path: Path) -> None:
    run, nominal = simulate(ARM, pushed), simulate(ARM)
    at, effect = Location("body", "b2"), effects()["body.force_intermittent"]
    assert isinstance(effect, BodyForceIntermittent)
    moved = motion(scene(tmp_path), run)
    shapes = effect.shapes(moved, at)
    assert shapes
    recording, start, end = shapes[0]
    assert recording == 0.0
    assert (start, end) == pytest.approx((0.8, 1.1), abs=0.04)
    found, _ = coefficients(moved, effect.columns(moved, at, (0.0, 0.8, 1.1)))
    assert effect.theta(found, ()) == pytest.approx(np.array([6.0, 2.0, -5.0]), rel=0.02)
    bound = effect.shaped((0.0, 0.8, 1.1))
    assert bound.observed() == {"windows": ("s", (0.8, 1.1))}
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    planted = Planted(bound, at, np.array([6.0, 2.0, -5.0]))
    replay = Replayer(scene(tmp_path), [stretch]).run([[planted]])
    assert np.std(replay.q[0] - run.q) < 0.02 * np.std(nominal.q - run.q)


def test_an_encoder_reads_too_much_or_too_little() -> None:
    offset = effects()["sensor.offset"]
    said = [offset.statement(J1, np.array([off])) for off in (0.08, -0.06)]
    assert said[0].endswith("reads 4.58° too much.")
    assert said[1].endswith("reads 3.44° too little.")
