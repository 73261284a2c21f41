"""Machines and logs to audit, made with plain MuJoCo and plain arrays.

Nothing of the package makes them: MJCF by hand, a loop over ``mj_step``, and faults put into the
columns after the fact, as loggers do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from wt.types import Recording

HEAD = '<compiler angle="radian" autolimits="true"/><option timestep="0.001"/>'
GEOM = 'contype="0" conaffinity="0"'

PLANAR = f"""<mujoco model="planar">{HEAD}<worldbody><body name="a" pos="0 0 1">
<joint name="hip" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1.1" {GEOM}/>
<body name="b" pos="0 0 -.4"><joint name="knee" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 .05 0 -.35" size=".03" mass=".7" {GEOM}/></body></body>
</worldbody><actuator>{{drives}}</actuator></mujoco>"""

ARM4 = f"""<mujoco model="arm4">{HEAD}<worldbody><body name="base" pos="0 0 .2">
<joint name="yaw" axis="0 0 1" damping="0.3"/>
<geom type="cylinder" size=".06 .05" mass="2" {GEOM}/><body name="up" pos=".05 0 .1">
<joint name="lift" axis="0 1 0" damping="0.3"/>
<geom type="box" pos=".12 0 .03" size=".13 .03 .03" mass="1.4" {GEOM}/>
<body name="low" pos=".26 0 0">
<joint name="bend" axis="0 1 0" damping="0.2" armature="0.05"/>
<geom type="box" pos=".1 .02 0" size=".1 .02 .02" mass=".8" {GEOM}/><body name="tool" pos=".2 0 0">
<joint name="roll" axis="1 0 0" damping="0.05" armature="0.02"/>
<geom type="box" pos=".04 .05 0" size=".04 .05 .01" mass=".35" {GEOM}/>
</body></body></body></body></worldbody><actuator>{{drives}}</actuator></mujoco>"""

GANTRY = f"""<mujoco model="gantry">{HEAD}<worldbody><body name="cart" pos="0 0 1">
<joint name="rail" type="slide" axis="1 0 0" damping="2"/>
<geom type="box" size=".1 .1 .05" mass="3" {GEOM}/><body name="post" pos="0 0 0">
<joint name="hoist" type="slide" axis="0 0 1" damping="2"/>
<geom type="box" size=".03 .03 .2" mass="1.5" {GEOM}/><body name="hand" pos="0 0 -.2">
<joint name="swing" axis="0 1 0" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 .02 0 -.25" size=".02" mass=".6" {GEOM}/></body></body></body>
</worldbody><actuator>{{drives}}</actuator></mujoco>"""


ROD = f"""<mujoco model="rod">{HEAD}<worldbody><body name="a" pos="0 0 1">
<joint name="hinge" axis="0 1 0" armature="0.01" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1.2" {GEOM}/></body>
</worldbody><actuator>{{drives}}</actuator></mujoco>"""


@dataclass(frozen=True)
class Machine:
    """A model, how it is moved, and gains of the loop around torque drives (none for servos).

    Servos with gears are told angles of their motors.
    """

    xml: str
    joints: tuple[str, ...]
    sizes: tuple[float, ...]
    loop: tuple[tuple[float, float], ...] = ()
    gears: tuple[float, ...] = ()


def _servos(*gains: tuple[str, float, float]) -> str:
    return "".join(
        f'<position name="{j}_m" joint="{j}" kp="{kp}" kv="{kv}"/>' for j, kp, kv in gains
    )


def _motors(*names: str) -> str:
    return "".join(f'<motor name="{j}_m" joint="{j}"/>' for j in names)


MACHINES = {
    "planar": Machine(
        PLANAR.format(drives=_servos(("hip", 60, 4), ("knee", 40, 2))), ("hip", "knee"), (0.7, 0.8)
    ),
    "planar_torque": Machine(
        PLANAR.format(drives=_motors("hip", "knee")),
        ("hip", "knee"),
        (0.9, 0.9),
        ((30, 3), (10, 0.8)),
    ),
    "arm4": Machine(
        ARM4.format(
            drives=_servos(("yaw", 80, 5), ("lift", 120, 6), ("bend", 60, 3), ("roll", 20, 0.6))
        ),
        ("yaw", "lift", "bend", "roll"),
        (0.8, 0.5, 0.7, 0.9),
    ),
    "arm4_torque": Machine(
        ARM4.format(drives=_motors("yaw", "lift", "bend", "roll")),
        ("yaw", "lift", "bend", "roll"),
        (0.8, 0.6, 0.8, 0.9),
        ((25, 2.5), (40, 4), (12, 1), (3, 0.25)),
    ),
    "gantry": Machine(
        GANTRY.format(drives=_servos(("rail", 900, 80), ("hoist", 1200, 90), ("swing", 12, 0.5))),
        ("rail", "hoist", "swing"),
        (0.3, 0.12, 0.8),
    ),
    "geared": Machine(
        PLANAR.format(
            drives='<position name="hip_m" joint="hip" gear="9" kp=".74" kv=".049"/>'
            '<position name="knee_m" joint="knee" gear="-20" kp=".1" kv=".005"/>'
        ),
        ("hip", "knee"),
        (0.7, 0.8),
        gears=(9.0, -20.0),
    ),
    "rod": Machine(ROD.format(drives=_servos(("hinge", 30, 2))), ("hinge",), (0.9,)),
}
SERVOS, TORQUE = ("planar", "arm4", "gantry"), ("planar_torque", "arm4_torque")


@lru_cache(maxsize=64)
def record(
    name: str, seed: int = 0, *, seconds: float = 4.0, rate: float = 100.0, robot: str = "",
    control: float | None = None, around: tuple[str, float] = ("", 0.0),
) -> Recording:  # fmt: skip
    """A clean log of a machine; ``robot`` is another MJCF that the log is of.

    One joint may move ``around`` another angle than zero.
    """
    machine = MACHINES[name]
    m = mujoco.MjModel.from_xml_string(robot or machine.xml)
    d = mujoco.MjData(m)
    rng = np.random.default_rng([seed, len(name)])
    t = np.arange(0.0, seconds, 1.0 / (control or rate))
    wave = np.stack([_wave(rng, t) for _ in machine.joints], axis=1)
    wanted = wave * machine.sizes
    wanted[:, [j == around[0] for j in machine.joints]] += around[1]
    every = round(1.0 / (control or rate) / m.opt.timestep)
    rows: dict[str, list] = {"q": [], "v": [], "u": []}
    d.qpos[:] = wanted[0]
    for target in wanted:
        u = target * np.array(machine.gears or 1.0)
        if machine.loop:
            kp, kv = np.array(machine.loop).T
            u = kp * (target - d.qpos) - kv * d.qvel
        rows["q"].append(d.qpos.copy())
        rows["v"].append(d.qvel.copy())
        rows["u"].append(u.copy())
        d.ctrl[:] = u
        for _ in range(every):
            mujoco.mj_step(m, d)
    q, v, u = (np.array(rows[k]) for k in "qvu")
    q = q + 1e-4 * rng.standard_normal(q.shape)
    v = v + 5e-3 * rng.standard_normal(v.shape)
    columns = {}
    for i, joint in enumerate(machine.joints):
        columns |= {f"ctrl/{joint}_m": u[:, i], f"qpos/{joint}": q[:, i], f"qvel/{joint}": v[:, i]}
    keep = slice(None, None, round((control or rate) / rate))
    return Recording(t[keep], {n: c[keep] for n, c in columns.items()}, {"robot": name})


def _wave(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """A sum of sines with a start at rest, between −1 and 1 or so."""
    f = rng.uniform(0.25, 1.6, 4)
    x = sum(np.sin(2 * np.pi * k * t + rng.uniform(0, 6.28)) / (1.0 + k) for k in f) + rng.uniform(
        -0.3, 0.3
    )
    return x / 1.6


@dataclass(frozen=True)
class Fault:
    """What was done to a log, and what is right to say: kinds that will do, and the columns."""

    id: str
    machine: str
    spoil: Callable[[Recording], Recording]
    kinds: tuple[str, ...]
    columns: frozenset[str]
    seed: int = 0
    options: dict[str, object] = field(default_factory=dict, hash=False)

    def log(self) -> Recording:
        """The spoiled log."""
        return self.spoil(record(self.machine, self.seed, **self.options))


def with_columns(recording: Recording, changed: dict[str, np.ndarray]) -> Recording:
    return replace(recording, columns={**recording.columns, **changed})


def times(factor: float, *names: str) -> Callable[[Recording], Recording]:
    return lambda r: with_columns(r, {n: r.columns[n] * factor for n in names})


def exchanged(*pairs: tuple[str, str]) -> Callable[[Recording], Recording]:
    def spoil(r: Recording) -> Recording:
        changed = {}
        for a, b in pairs:
            changed |= {a: r.columns[b], b: r.columns[a]}
        return with_columns(r, changed)

    return spoil


def wrapped(name: str, turn: float = 2 * np.pi) -> Callable[[Recording], Recording]:
    """An encoder that shows angles from minus half a turn to half a turn only."""

    def spoil(r: Recording) -> Recording:
        x = r.columns[name]
        return with_columns(r, {name: (x + turn / 2) % turn - turn / 2})

    return spoil


def clock(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, t=change(r.t))


def write_model(name: str, folder: Path) -> Path:
    path = folder / f"{name}.xml"
    path.write_text(MACHINES[name].xml)
    return path
