"""The best addition is judged with tolerances as they adapt around itself."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.addition import addition
from wt.diagnose.selection.decisions import DecisionLog
from wt.physics.scene import Scene
from wt.types import Recording

LINK = """\
<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body name="link"><joint name="hinge" axis="0 1 0" damping=".1"{rotor}/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1.2"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="90" kv="5"/></actuator></mujoco>
"""
RATE, NOISE = 100, 1e-5  # Hz; rad: so quiet that what is linear in the tolerances falls short


def record(seconds: float) -> Recording:
    """A multisine with steps, followed with a rotor of .03 kg·m²."""
    model = mujoco.MjModel.from_xml_string(LINK.format(rotor=' armature=".03"'))
    data, rng = mujoco.MjData(model), np.random.default_rng(4)
    t = np.arange(int(seconds * RATE)) / RATE
    rate, phase = rng.uniform(0.15, 1.2, 4), rng.uniform(0.0, 6.28, 4)
    u = 0.2 * np.sin(2.0 * np.pi * t[:, None] * rate + phase).sum(axis=1)
    u = (u + 0.3 * (np.floor(t / 1.7) % 2)) * np.minimum(t / 2.0, 1.0)
    q = np.empty(len(t))
    for k in range(len(t)):
        q[k] = data.qpos[0]
        data.ctrl[:] = u[k]
        mujoco.mj_step(model, data, 20)
    q += NOISE * rng.standard_normal(len(t))
    return Recording(t, {"qpos/hinge": q, "ctrl/servo": u})


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Screen, Objective]:
    path = tmp_path_factory.mktemp("link") / "link.xml"
    path.write_text(LINK.format(rotor=""))
    fitted = smooth(Scene(path), [Part(record(10.0), 0)])
    screen = Screen(fitted, 0)
    replays = stretches_of(fitted, forgets=True)
    return screen, Objective(fitted, replays, screen.velocity_noise, 1e-3, True)


def test_a_rotor_is_not_taken_for_an_elastic_gear(judged: tuple[Screen, Objective]) -> None:
    screen, objective = judged
    joined = addition(screen, objective, objective.reference(()), [], DecisionLog(), 4)
    assert [a.planted.effect.id for a in joined] == ["joint.armature"]
    (inertia,) = joined[0].planted.theta
    assert inertia == pytest.approx(0.03, rel=0.05)
