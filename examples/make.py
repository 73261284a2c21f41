"""Make the examples anew: ``python examples/make.py [FOLDER]``; the same bytes every time.

Each folder holds ``model.xml``, the MJCF that a user believes in, two recordings of a machine that
differs from it, and ``answer.json``: in what. The machine is MJCF too, written out here by hand and
stepped by plain MuJoCo; nothing of the diagnosis is used to make it.

=========  =============================================  ====================================
example    machine                                        hidden in it
=========  =============================================  ====================================
``arm``    a tool on one joint, on a position servo       40 mrad of play in the joint's gear
``cart``   a cart on a rail, on a position servo           1.2 N of dry friction on the rail
``go2``    a quadruped of the Unitree Go2's proportions   2.4 kg on its back
=========  =============================================  ====================================
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from wt.data import recording
from wt.types import Recording
from wt.worlds import go2_model
from wt.worlds.robots import mjcf

HERE = Path(__file__).parent
GAP, FRICTION, LOAD = 0.04, 1.2, 2.4  # rad, N, kg
PLACE = (-0.08, 0.03, 0.09)  # m, of the load in the frame of the trunk

ARM = """\
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <default>
    <geom contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <body name="upper" pos="0 0 0.4">
      <joint name="shoulder" axis="0 1 0" range="-1.6 1.6" armature="0.08" damping="0.6"/>
      <geom name="upper" type="capsule" size="0.04" fromto="0 0 0 0 0 -0.3" mass="1.6"/>
      <geom name="tool" type="sphere" size="0.05" pos="0 0 -0.3" mass="0.5"/>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="260" kv="24" forcerange="-120 120"/>
  </actuator>
</mujoco>
"""

CART = """\
<mujoco model="cart">
  <option timestep="0.002"/>
  <default>
    <geom contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <geom name="rail" type="capsule" size="0.01" fromto="-1 0 1 1 0 1"/>
    <body name="cart" pos="0 0 1">
      <joint name="rail" type="slide" axis="1 0 0" range="-0.9 0.9" damping="0.8"/>
      <geom name="cart" type="box" size="0.1 0.06 0.04" mass="1.5"/>
    </body>
  </worldbody>
  <actuator>
    <position name="drive" joint="rail" kp="90" kv="14" forcerange="-40 40"/>
  </actuator>
</mujoco>
"""


def hidden_arm() -> mujoco.MjModel:
    """The joint's rotor turns beside the link and takes it along where its teeth touch."""
    spec = mujoco.MjSpec.from_string(ARM)
    spec.option.timestep = 2.5e-4
    link = spec.joint("shoulder")
    axis, armature, damping = link.axis, float(link.armature), [*link.damping]
    link.armature, link.damping = 0.0, [0.0, 0.0, 0.0]
    rotor = spec.worldbody.add_body(name="rotor", pos=spec.body("upper").pos)
    rotor.add_joint(name="rotor", axis=axis, armature=armature, damping=damping)
    rotor.explicitinertial, rotor.mass, rotor.inertia = True, 1e-6, [1e-8] * 3
    teeth = spec.add_tendon(name="teeth", range=[-GAP / 2, GAP / 2], limited=True)
    teeth.solref_limit = [0.001, 1.0]
    teeth.wrap_joint("shoulder", 1.0)
    teeth.wrap_joint("rotor", -1.0)
    spec.actuator("shoulder").target = "rotor"
    return spec.compile()


def hidden_cart() -> mujoco.MjModel:
    """Dry friction between cart and rail."""
    spec = mujoco.MjSpec.from_string(CART)
    spec.option.timestep = 2.5e-4
    spec.joint("rail").frictionloss = FRICTION
    return spec.compile()


def hidden_go2() -> mujoco.MjModel:
    """A block on the trunk."""
    spec = go2_model.spec(go2_model.PUBLISHED, 1e-3)
    # a body of its own: the trunk has an inertial, beside which its geoms weigh nothing
    load = spec.body(go2_model.TRUNK).add_body(name="load", pos=PLACE)
    load.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.06, 0.04, 0.03], mass=LOAD,
        contype=0, conaffinity=0,
    )  # fmt: skip
    return spec.compile()


def _multisine(
    t: np.ndarray, middle: np.ndarray, size: np.ndarray, tempo: float, rng: np.random.Generator
) -> np.ndarray:
    """A smooth motion about ``middle``, (time, joint); slow for a second at its beginning."""
    f = tempo * rng.uniform(0.08, 0.8, (5, len(middle)))
    phase = rng.uniform(0, 2 * np.pi, f.shape)
    waves = np.sin(2 * np.pi * f * t[:, None, None] + phase) / (0.4 + f)
    wave = waves.sum(axis=1)
    start = np.clip(t, 0, 1)[:, None]
    return middle + size * start**2 * (3 - 2 * start) * wave / np.abs(wave).max(axis=0)


def _record(
    model: mujoco.MjModel,
    command: np.ndarray,
    rate: float,
    steps: Mapping[str, float],
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """What encoders say while the commands are given.

    Args:
        model: the hidden machine, its pose that of the first keyframe, if it has one.
        command: (sample, actuator), each held until the next sample.
        rate: of samples [Hz].
        steps: kind of column → resolution of its sensor, also the rms of its noise.
        rng: of the noise.
    """
    data, every = mujoco.MjData(model), round(1 / rate / model.opt.timestep)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = command[0]
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    rows = []
    for u in command:
        rows.append(np.concatenate([data.qpos, data.qvel]))
        data.ctrl[:] = u
        mujoco.mj_step(model, data, every)
    states = np.array(rows)
    columns = {f"ctrl/{model.actuator(i).name}": command[:, i] for i in range(model.nu)}
    for joint in (model.joint(i) for i in range(model.njnt)):
        if joint.name == "rotor":  # no encoder
            continue
        q, v = int(joint.qposadr[0]), model.nq + int(joint.dofadr[0])
        free = joint.type[0] == mujoco.mjtJoint.mjJNT_FREE
        for kind, at, size in (("qpos", q, 7), ("qvel", v, 6)):
            for i in range(size if free else 1):
                name = f"{kind}/{joint.name}" + (f"/{i}" if free else "")
                step = steps[kind + "/free" * free]
                noisy = states[:, at + i] + rng.normal(0, step, len(states))
                columns[name] = np.round(noisy / step) * step
    return columns


def _arm(rng: np.random.Generator) -> dict[str, np.ndarray]:
    t = np.arange(0, 8, 0.01)
    # gravity pulls the joint either way, so that the teeth change sides
    path = _multisine(t, np.zeros(1), np.array([0.9]), 1.0, rng)
    steps = {"qpos": 2e-4, "qvel": 5e-3}
    return {"t": t, **_record(hidden_arm(), path, 100, steps, rng)}


def _cart(rng: np.random.Generator) -> dict[str, np.ndarray]:
    t = np.arange(0, 8, 0.005)
    path = _multisine(t, np.zeros(1), np.array([0.5]), 0.8, rng)
    steps = {"qpos": 1e-4, "qvel": 2e-3}
    return {"t": t, **_record(hidden_cart(), path, 200, steps, rng)}


def _go2(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """It sways on its feet."""
    t = np.arange(0, 10, 0.01)
    size = np.tile([0.08, 0.16, 0.16], 4)
    # hips and knees mostly together, or its feet would slide
    legs = _multisine(t, np.zeros(3), np.ones(3), 1.6, rng)
    own = _multisine(t, np.zeros(12), np.ones(12), 1.6, rng)
    path = go2_model.DEFAULT + size * (np.tile(legs, 4) + 0.25 * own)
    steps = {"qpos": 2e-4, "qvel": 5e-3, "qpos/free": 2e-4, "qvel/free": 5e-3}
    return {"t": t, **_record(hidden_go2(), path, 100, steps, rng)}


EXAMPLES = {
    "arm": (ARM, _arm, "joint.backlash", "joint", "shoulder", {"gap": GAP}),
    "cart": (CART, _cart, "joint.friction_coulomb", "joint", "rail", {"coulomb": FRICTION}),
    "go2": (
        mjcf("go2"), _go2, "body.payload_fixed", "body", go2_model.TRUNK,
        {"mass": LOAD, "position": list(PLACE)},
    ),
}  # fmt: skip
"""Name → MJCF, maker of a recording, and the effect that is hidden, where, and how large."""


def make(folder: Path) -> None:
    """Write every example, each in a folder of its name."""
    for number, (name, (xml, record, effect, kind, place, parameters)) in enumerate(
        EXAMPLES.items()
    ):
        target = folder / name
        target.mkdir(parents=True, exist_ok=True)
        (target / "model.xml").write_text(xml, encoding="utf-8")
        for take in (1, 2):
            columns = record(np.random.default_rng([number, take]))
            meta = {"robot": name, "source": "examples/make.py, simulated", "license": "Apache-2.0"}
            recording.write(Recording(columns.pop("t"), columns, meta), target / f"{take}.parquet")
        at = {"kind": kind, "name": place}
        answer = {"truth": [{"effect": effect, "at": at, "parameters": parameters}]}
        (target / "answer.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
