"""A joint that no drive moves says whether a column is wrong or the model lacks physics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.check.run import check
from wt.physics.scene import Scene
from wt.types import Recording

CART = """<mujoco model="cart"><compiler angle="radian"/><option timestep=".001"/><worldbody>
<body name="cart"><joint name="rail" type="slide" axis="1 0 0" damping=".01"/>
<geom type="box" size=".1 .1 .05" mass="{cart}"/><body name="pole"><joint name="swing" axis="0 1 0"
damping="1e-4"/><geom type="capsule" fromto="0 0 0 0 0 -.8" size=".02" mass=".15"/>
<geom type="sphere" size=".03" pos="0 0 -{at}" mass="{load}"/></body></body></worldbody>
<actuator><motor name="push" joint="rail" gear="5"/></actuator></mujoco>"""
RATE, NOISE = 100, 1e-4
Change = Callable[[np.ndarray], np.ndarray]


def model(cart: float = 0.8, load: float = 1e-6, at: float = 0.7) -> str:
    return CART.format(cart=cart, load=load, at=at)


def recorded(xml: str, seed: int) -> Recording:
    """The cart follows waves by a soft loop, and the pole swings along."""
    m = mujoco.MjModel.from_xml_string(xml)
    d, rng, n = mujoco.MjData(m), np.random.default_rng(seed), 1200
    t = np.arange(n) / RATE
    rate, phase = rng.uniform(0.1, 0.8, 4), rng.uniform(0.0, 6.28, 4)
    goal = 0.05 * np.sin(2 * np.pi * t[:, None] * rate + phase).sum(axis=1)
    goal *= np.minimum(t / 2.0, 1.0)
    q, u = np.empty((n, 2)), np.empty(n)
    for k in range(n):
        q[k] = d.qpos
        u[k] = (60.0 * (goal[k] - d.qpos[0]) - 11.0 * d.qvel[0]) / 5.0
        d.ctrl[:] = u[k]
        mujoco.mj_step(m, d, round(1.0 / (RATE * m.opt.timestep)))
    q += NOISE * rng.standard_normal(q.shape)
    return Recording(t, {"qpos/rail": q[:, 0], "qpos/swing": q[:, 1], "ctrl/push": u})


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "cart.xml").write_text(model())
    return Scene(tmp_path / "cart.xml")


@pytest.mark.parametrize("load", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_load_on_the_pole_is_no_unit_of_the_cart(scene: Scene, load: float, seed: int) -> None:
    assert not check(scene, recorded(model(load=load), seed)).findings


@pytest.mark.parametrize("seed", [0, 1])
def test_a_unit_of_the_cart_is_one(scene: Scene, seed: int) -> None:
    recording = recorded(model(), seed)
    columns = recording.columns | {"qpos/rail": 1e3 * recording.columns["qpos/rail"]}
    (found,) = check(scene, Recording(recording.t, columns)).findings
    assert found.kind == "position_unit"
    assert "mm" in found.evidence


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("encoder_sign", lambda q: -q),
        ("position_unit", np.degrees),
        ("encoder_zero", lambda q: q + np.pi),
        ("encoder_zero", lambda q: q - np.pi / 2.0),
    ],
)
def test_a_pole_that_nothing_drives(scene: Scene, kind: str, change: Change) -> None:
    recording = recorded(model(), 0)
    columns = recording.columns | {"qpos/swing": change(recording.columns["qpos/swing"])}
    checked = check(scene, Recording(recording.t, columns))
    (found,) = checked.findings
    assert (found.kind, found.columns, found.sure) == (kind, ("qpos/swing",), True)
    assert checked.recording is not None
    right = recording.columns["qpos/swing"]
    np.testing.assert_allclose(checked.recording.columns["qpos/swing"], right, atol=1e-4)


PENDULUM = """<mujoco><option timestep=".001"/><worldbody><body><joint name="swing" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -.6" size=".02" mass=".8"/></body></worldbody></mujoco>"""


def swing(xml: str) -> Recording:
    """A pendulum that is let go."""
    m = mujoco.MjModel.from_xml_string(xml)
    d, q = mujoco.MjData(m), np.empty(800)
    d.qpos[0] = 1.3
    for k in range(len(q)):
        q[k] = d.qpos[0]
        mujoco.mj_step(m, d, 10)
    q += NOISE * np.random.default_rng(0).standard_normal(len(q))
    return Recording(np.arange(len(q)) / RATE, {"qpos/swing": q})


def test_a_free_pendulum_in_degrees(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(PENDULUM)
    given = swing(PENDULUM)
    degrees = Recording(given.t, {"qpos/swing": np.degrees(given.columns["qpos/swing"])})
    (found,) = check(Scene(tmp_path / "m.xml"), degrees).findings
    assert (found.kind, found.columns) == ("position_unit", ("qpos/swing",))
    assert "degrees" in found.evidence


@pytest.mark.parametrize(
    "joint",
    ['damping=".3"', 'frictionloss=".3"', 'stiffness="3"', 'armature=".2"', 'stiffness="-1.5"'],
)
def test_what_a_free_pendulum_lacks_is_no_fault(joint: str, tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(PENDULUM)
    robot = PENDULUM.replace('axis="0 1 0"', f'axis="0 1 0" {joint}')
    assert not check(Scene(tmp_path / "m.xml"), swing(robot)).findings
