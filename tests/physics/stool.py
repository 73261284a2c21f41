"""A small machine on three legs that nothing holds, and its simulation in a plain loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np

from wt.physics.scene import Scene
from wt.types import Recording

Array = np.ndarray

LEGS = ("left", "right", "rear")
JOINTS = tuple(f"{leg}_{part}" for leg in LEGS for part in ("hip", "knee"))
_LEG = """
      <body name="{leg}_thigh" pos="{x} {y} 0">
        <joint name="{leg}_hip" axis="{y} {x} 0" damping="0.1" armature="0.005"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.015" mass="0.4" contype="0"
          conaffinity="0"/>
        <body name="{leg}_shank" pos="0 0 -0.15">
          <joint name="{leg}_knee" axis="0 1 0" damping="0.1" armature="0.005"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.012" mass="0.2" contype="0"
            conaffinity="0"/>
          <geom name="{leg}_foot" type="sphere" pos="0 0 -0.15" size="0.02" mass="0.05"/>
        </body>
      </body>"""
_AT = dict(zip(LEGS, ((0.18, 0.2), (0.18, -0.2), (-0.25, 0.02)), strict=True))
HEIGHT = 0.32  # m, of the trunk's origin where the feet touch
STOOL = """<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="trunk" pos="0 0 {height}">
      <freejoint name="root"/>
      <geom name="trunk" type="box" size="0.2 0.15 0.04" mass="4" contype="0" conaffinity="0"/>
      <site name="imu" pos="0.05 -0.03 0.02" euler="0.2 -0.3 1.2"/>
      {legs}
    </body>
  </worldbody>
  <actuator>
    {drives}
  </actuator>
  <sensor>
    <gyro name="gyro" site="imu"/>
    <accelerometer name="accelerometer" site="imu"/>
    <framequat name="orientation" objtype="site" objname="imu"/>
  </sensor>
  <keyframe><key name="stand" qpos="0 0 {height} 1 0 0 0 0 0 0 0 0 0"/></keyframe>
</mujoco>""".format(
    height=HEIGHT,
    legs="".join(_LEG.format(leg=leg, x=x, y=y) for leg, (x, y) in _AT.items()),
    drives="\n    ".join(f'<position name="{j}" joint="{j}" kp="40" kv="1"/>' for j in JOINTS),
)

Edit = Callable[[mujoco.MjSpec], None]


def scene(folder: Path) -> Scene:
    """The machine as the model has it."""
    path = folder / "stool.xml"
    path.write_text(STOOL)
    return Scene(path)


def recording(
    seed: int,
    edit: Edit | None = None,
    seconds: float = 8.0,
    rate: float = 100.0,
    imu: Sequence[str] = (),
    push: Callable[[float], Sequence[float]] | None = None,
) -> Recording:
    """What is recorded of a machine that shuffles about, with something hidden in it.

    Args:
        seed: of its motion and of the noise.
        edit: hides it.
        seconds: duration.
        rate: of the samples [Hz].
        imu: names of the sensors that are recorded too.
        push: force on the trunk [N] at a time [s].
    """
    spec = mujoco.MjSpec.from_string(STOOL)
    spec.option.timestep = 0.0005
    if edit:
        edit(spec)
    model = spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[2] = HEIGHT
    t = np.arange(round(seconds * rate)) / rate
    phase, pace = rng.uniform(0, 2 * np.pi, (2, 6, 1)), rng.uniform(0.5, 2.5, (2, 6, 1))
    waves = 0.12 * np.sin(2 * np.pi * pace[0] * t + phase[0])
    waves += 0.06 * np.sin(4 * np.pi * pace[1] * t + phase[1])
    held = (waves * np.clip(t, 0, 1)).T
    # what a hidden load does is not seen; its joint is the last one
    q, v = np.empty((len(t), 7 + len(JOINTS))), np.empty((len(t), 6 + len(JOINTS)))
    sensed = {name: np.empty((len(t), int(model.sensor(name).dim[0]))) for name in imu}
    for k, command in enumerate(held):
        q[k], v[k] = data.qpos[: q.shape[1]], data.qvel[: v.shape[1]]
        data.ctrl[:] = command
        if sensed:
            mujoco.mj_forward(model, data)
        for name, column in sensed.items():
            column[k] = data.sensor(name).data
        for _ in range(round(1.0 / (rate * model.opt.timestep))):
            if push:
                data.xfrc_applied[model.body("trunk").id, :3] = push(data.time)
            mujoco.mj_step(model, data)
    noise = np.concatenate([np.full(3, 3e-4), np.full(4, 3e-4), np.full(6, 1e-4)])
    q += noise * rng.normal(size=q.shape)
    v += np.concatenate([np.full(3, 5e-3), np.full(9, 3e-3)]) * rng.normal(size=v.shape)
    columns = {f"qpos/root/{k}": q[:, k] for k in range(7)}
    columns |= {f"qvel/root/{k}": v[:, k] for k in range(6)}
    for name, column in sensed.items():
        columns |= {f"sensor/{name}/{k}": x for k, x in enumerate(column.T)}
    for i, joint in enumerate(JOINTS):
        columns |= {f"qpos/{joint}": q[:, 7 + i], f"qvel/{joint}": v[:, 6 + i]}
        columns |= {f"ctrl/{joint}": held[:, i]}
    return Recording(t, columns, {"source": f"stool {seed}"})


def loaded(mass: float, at: tuple[float, float, float]) -> Edit:
    """Something on the trunk."""

    def edit(spec: mujoco.MjSpec) -> None:
        body = spec.body("trunk").add_body(pos=at)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=mass, contype=0,
            conaffinity=0,
        )  # fmt: skip

    return edit


def stiff(joint: str, torque: float) -> Edit:
    """Dry friction in a joint."""

    def edit(spec: mujoco.MjSpec) -> None:
        spec.joint(joint).frictionloss = torque

    return edit


def smooth_soles(friction: float) -> Edit:
    """Feet and floor that slide."""

    def edit(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            geom.friction[0] = friction

    return edit
