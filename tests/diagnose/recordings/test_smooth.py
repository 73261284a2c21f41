"""Where drives that integrate began, which no recording says, whatever else a model lacks."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Recording

STEP, EVERY, NOISE = 5e-4, 20, 1e-4
LEVEL = f"""<mujoco><option timestep="{STEP}" integrator="implicitfast"/><worldbody>
  <body name="upper"><joint name="a" axis="0 1 0" damping="0.2" frictionloss="0"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1" contype="0"/>
    <body pos="0.3 0 0"><joint name="b" axis="0 1 0" damping="0.2"/>
      <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.5" contype="0"/></body>
  </body></worldbody>
  <actuator><intvelocity name="a" joint="a" kp="40" kv="3" actrange="-1 1"/>
    <position name="b" joint="b" kp="20" kv="2"/></actuator></mujoco>"""
"""An arm held level, so that its weight is nearly the same all the time."""
UNMODELLED = {
    "nothing": ("", ""),
    "friction": ('frictionloss="0"', 'frictionloss="0.3"'),
    "load": ('mass="0.5"', 'mass="0.7"'),
}


def recorded(xml: str, start: float) -> Recording:
    """Five seconds of a machine whose first drive begins at ``start`` [rad], with noise."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, rng, n = mujoco.MjData(model), np.random.default_rng(0), 500
    t = np.arange(n) * STEP * EVERY
    command = np.stack([0.5 * np.sin(3.0 * t + 1.0), 0.5 * np.sin(4.4 * t)], axis=1)
    q, v = np.empty((n, 2)), np.empty((n, 2))
    data.act[0] = data.qpos[0] = start
    for k in range(n):
        data.ctrl[:], q[k], v[k] = command[k], data.qpos, data.qvel
        mujoco.mj_step(model, data, EVERY)
    q += NOISE * rng.standard_normal(q.shape)
    v += 10.0 * NOISE * rng.standard_normal(v.shape)
    columns = {f"ctrl/{j}": command[:, i] for i, j in enumerate("ab")}
    columns |= {f"qpos/{j}": q[:, i] for i, j in enumerate("ab")}
    columns |= {f"qvel/{j}": v[:, i] for i, j in enumerate("ab")}
    return Recording(t, columns, {"robot": "level"})


def smoothed(folder: Path, xml: str, start: float) -> Smoothed:
    (folder / "level.xml").write_text(LEVEL)
    return smooth(Scene(folder / "level.xml"), [Part(recorded(xml, start), 0)])


@pytest.mark.parametrize("lacks", UNMODELLED)
@pytest.mark.parametrize("start", [0.0, 0.2])
def test_an_integrator_begins_where_it_did(lacks: str, start: float, tmp_path: Path) -> None:
    found = smoothed(tmp_path, LEVEL.replace(*UNMODELLED[lacks]), start)
    # a drive of 40 N·m/rad carries .8 N·m more of a load, which hardly changes: it is shared out
    assert found.begun[0][0] == pytest.approx(start, abs=0.015 if lacks == "load" else 2e-4)


def test_a_replay_of_a_clean_recording_errs_by_little_more_than_the_noise(tmp_path: Path) -> None:
    found = smoothed(tmp_path, LEVEL, 0.2)
    pairs = stretches_of(found, forgets=True)
    q = Replayer(found.motion.scene, [s for s, _ in pairs], STEP).run([()]).q[0]
    error = (q - np.concatenate([measured for _, measured in pairs]))[:, 0]
    # a setpoint moves in the half physics step by which commands come late
    assert np.sqrt(np.mean(error**2)) < 2.0 * NOISE
