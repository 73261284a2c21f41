"""A three-joint arm written by hand, and its simulation in a plain loop: truth for effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from wt.physics.motion import Motion, Segment
from wt.physics.scene import Scene

Array = np.ndarray

H = 5e-4
JOINTS = 3
ARM = """<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.0005" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="b0" pos="0 0 0.5">
      <joint name="j0" axis="0 0 1" armature="0.01"/>
      <geom name="g0" type="box" size="0.05 0.04 0.06" mass="1.5"/>
      <body name="b1" pos="0 0 0.1">
        <joint name="j1" axis="0 1 0" armature="0.02"/>
        <inertial pos="0.15 0.01 0.02" mass="1.2" diaginertia="0.004 0.012 0.011"/>
        <geom name="g1" type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
        <body name="b2" pos="0.3 0 0">
          <joint name="j2" axis="0 1 0" armature="0.01"/>
          <geom name="g2" type="box" pos="0.12 0.02 0.01" size="0.12 0.03 0.02" mass="0.8"/>
          <body name="b3" pos="0.22 0.03 0.02">
            <geom name="g3" type="sphere" size="0.02" mass="0.1"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general name="m0" joint="j0" gainprm="30" biastype="affine" biasprm="0 -30 -2"/>
    <general name="m1" joint="j1" gainprm="60" biastype="affine" biasprm="0 -60 -3"/>
    <general name="m2" joint="j2" gainprm="30" biastype="affine" biasprm="0 -30 -1"/>
  </actuator>
  <contact><exclude body1="b0" body2="b1"/><exclude body1="b1" body2="b2"/></contact>
</mujoco>"""
GAINS = {"m0": (30.0, 2.0), "m1": (60.0, 3.0), "m2": (30.0, 1.0)}

Hook = Callable[[mujoco.MjModel, mujoco.MjData], None]
"""Acts between the command and the physics step: may change ctrl and applied forces."""


@dataclass(frozen=True, eq=False)
class Run:
    """A simulated recording at every physics step.

    A held command changes at a sample; MuJoCo's semi-implicit step stands for the time around its
    start. So the simulation acts with the mean of the commands before and after.
    """

    t: Array
    held: Array
    q: Array
    v: Array
    a: Array


def commands(seconds: float) -> tuple[Array, Array]:
    """(t, joint targets): sums of sines that start at rest."""
    t = H * np.arange(round(seconds / H))
    waves = [
        (0.5, 0.7, 0.0, 0.2, 2.3, 0.9),
        (0.45, 0.55, 0.4, 0.22, 1.9, 0.0),
        (0.5, 0.8, 1.0, 0.2, 2.6, 0.3),
    ]
    u = [
        a * np.sin(2 * np.pi * f * t + p) + b * np.sin(2 * np.pi * g * t + r)
        for a, f, p, b, g, r in waves
    ]
    return t, np.stack(u, axis=1) * (1.0 - np.exp(-t / 0.1))[:, None]


def edited(*changes: tuple[str, str]) -> str:
    """The arm's MJCF with some text replaced."""
    xml = ARM
    for old, new in changes:
        assert xml.count(old) == 1, old
        xml = xml.replace(old, new)
    return xml


def simulate(xml: str, hook: Hook | None = None, seconds: float = 2.0) -> Run:
    """Run an MJCF under the commands, from rest at zero; joints beyond the arm's are not seen."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    t, held = commands(seconds)
    u = 0.5 * (held + np.vstack([held[:1], held[:-1]]))
    q, v, a = (np.empty((len(t), JOINTS)) for _ in range(3))
    for k in range(len(t)):
        data.ctrl[:], data.qfrc_applied[:], data.xfrc_applied[:] = u[k], 0.0, 0.0
        if hook is not None:
            mujoco.mj_fwdPosition(model, data)
            hook(model, data)
        mujoco.mj_forward(model, data)
        q[k], v[k], a[k] = data.qpos[:JOINTS], data.qvel[:JOINTS], data.qacc[:JOINTS]
        mujoco.mj_step(model, data)
    return Run(t, held, q, v, a)


def scene(folder: Path, xml: str = ARM) -> Scene:
    """The scene of an MJCF."""
    path = folder / "arm.xml"
    path.write_text(xml)
    return Scene(path)


def motion(of: Scene, run: Run) -> Motion:
    """What the recording of a run reveals."""
    whole = Segment(slice(0, len(run.t)), 0, H)
    return Motion(of, (whole,), run.t, run.q, run.v, run.a, run.held)


def coefficients(moved: Motion, columns: Array) -> tuple[Array, float]:
    """Least squares coefficients of columns, and the share of the residual they leave."""
    flat, target = columns.reshape(-1, columns.shape[2]), moved.residual.reshape(-1)
    found = np.linalg.lstsq(flat, target, rcond=None)[0]
    return found, float(np.linalg.norm(target - flat @ found) / np.linalg.norm(target))


def servo(data: mujoco.MjData, name: str, index: int) -> float:
    """Force that a servo of the arm would give, by its law."""
    kp, kv = GAINS[name]
    return float(kp * (data.ctrl[index] - data.qpos[index]) - kv * data.qvel[index])
