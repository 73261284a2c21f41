"""Physics that the arm may have: MJCF written by hand, and laws in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from tests.physics.arm import GAINS, H, Hook, Run, edited, servo

Array = np.ndarray

J1 = 'name="j1" axis="0 1 0" armature="0.02"'
M1 = 'gainprm="60" biastype="affine" biasprm="0 -60 -3"'
B2 = 'mass="0.8"'
INERTIAL = '<inertial pos="0.15 0.01 0.02" mass="1.2" diaginertia="0.004 0.012 0.011"/>'


def joint(attributes: str) -> str:
    return edited((J1, f"{J1} {attributes}"))


def push(law: Callable[[mujoco.MjData], float]) -> Callable[[], Hook]:
    """Torque on joint j1 by a law of the state."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[1] += law(data)

    return lambda: hook


def instead(law: Callable[[float, mujoco.MjData], float]) -> Callable[[], Hook]:
    """Another force of drive m1 instead of its own."""
    return push(lambda d: law(servo(d, "m1", 1), d) - servo(d, "m1", 1))


def smooth_sign(v: float) -> float:
    return float(np.clip(v / 0.004, -1.0, 1.0))


def stribeck(d: mujoco.MjData) -> float:
    v = d.qvel[1]
    return -smooth_sign(v) * (0.8 + 0.6 * np.exp(-((v / 0.3) ** 2)))


def load(d: mujoco.MjData) -> float:
    return -smooth_sign(d.qvel[1]) * (0.3 + 0.2 * abs(servo(d, "m1", 1)))


def lossy(d: mujoco.MjData) -> float:
    v, force = d.qvel[1], servo(d, "m1", 1)
    share = 0.1 if force * v > 0.0 else 0.35
    return -smooth_sign(v) * (0.3 + 0.2 * abs(v) + share * abs(force))


def directed(d: mujoco.MjData) -> float:
    v = d.qvel[1]
    return -smooth_sign(v) * (0.5 + 0.2 * v if v > 0.0 else 0.9 - 0.6 * v)


def along(d: mujoco.MjData) -> float:
    return -smooth_sign(d.qvel[1]) * 0.8 * (1.0 + 0.6 * np.sin(4.0 * d.qpos[1] + 0.5))


def leaking() -> Hook:
    """A fifth of the force of drive m1 acts on j2, too, the other way round."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[2] -= 0.2 * servo(data, "m1", 1)

    return hook


def belted() -> Hook:
    """A belt over j1 and j2, which is stretched by the first and slackened by the second."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        pull = 6.0 * (data.qpos[1] - 0.8 * data.qpos[2] - 0.3)
        data.qfrc_applied[1:] += -pull, 0.8 * pull

    return hook


def carried() -> Hook:
    """A force upwards on every link, of 0.7 of its weight."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        for body in range(1, model.nbody):
            data.xfrc_applied[body, 2] += 0.7 * 9.81 * model.body_mass[body]

    return hook


def play_operator() -> Hook:
    state = {"z": 0.0, "q": 0.0}

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        state["z"] = float(np.clip(state["z"] + data.qpos[1] - state["q"], -0.1, 0.1))
        state["q"] = float(data.qpos[1])
        data.qfrc_applied[1] -= 12.0 * state["z"]

    return hook


def two_masses(gear: Callable[[float, float], float]) -> Callable[[], Hook]:
    """The rotor of j1 (0.02 kg·m²) behind a gear torque of twist and twist rate, by hand."""

    def start() -> Hook:
        state = {"angle": 0.0, "speed": 0.0}
        kp, kv = GAINS["m1"]

        def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            total, steps = 0.0, 10
            for _ in range(steps):
                torque = gear(state["angle"] - data.qpos[1], state["speed"] - data.qvel[1])
                drive = kp * (data.ctrl[1] - state["angle"]) - kv * state["speed"]
                state["speed"] += H / steps * (drive - torque) / 0.02
                state["angle"] += H / steps * state["speed"]
                total += torque / steps
            data.qfrc_applied[1] += total - servo(data, "m1", 1)

        return hook

    return start


def play(twist: float, rate: float) -> float:
    beyond = twist - np.clip(twist, -0.02, 0.02)
    return float(8000.0 * beyond + (6.0 * rate if beyond else 0.0))


LINK_ONLY = edited((J1, 'name="j1" axis="0 1 0"'))


def filtered() -> Hook:
    state: dict[str, float] = {}

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        u = float(data.ctrl[1])
        x = state.setdefault("x", u)
        data.ctrl[1] = x
        state["x"] = u + (x - u) * np.exp(-H / 0.02)

    return hook


def late(drives: slice = slice(1, 2)) -> Hook:
    memory: list[Array] = []

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        memory.append(data.ctrl[drives].copy())
        data.ctrl[drives] = memory[max(0, len(memory) - 1 - 24)]

    return hook


def ahead(coefficient: float = 2.0, steps: int = 5) -> Hook:
    """The command's difference over some steps as a velocity, into the joint."""
    memory: list[float] = []

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        memory.append(float(data.ctrl[1]))
        rate = (memory[-1] - memory[max(0, len(memory) - 1 - steps)]) / (steps * H)
        data.qfrc_applied[1] += coefficient * rate

    return hook


def leaning(ki: float = 40.0) -> Hook:
    """The servo's position error, summed up over time, pushes j1."""
    total = {"error": 0.0}

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[1] += ki * total["error"]
        total["error"] += H * float(data.ctrl[1] - data.qpos[1])

    return hook


def slow(speed: float = 0.8) -> Hook:
    """The servo's target walks to its command in steps that are never larger than it may."""
    memory: list[float] = []

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        u = float(data.ctrl[1])
        last = memory[-1] if memory else u
        way = abs(u - last)
        memory.append(u if way <= speed * H else last + speed * H * (u - last) / way)
        data.ctrl[1] = memory[-1]

    return hook


def planned(speed: float = 0.9, acceleration: float = 6.0) -> Hook:
    """The servo's target speeds up and slows down evenly so that it comes to rest at its command.

    Whatever lets it stop in time is chosen of speeding up, going on and slowing down.
    """
    state: dict[str, float] = {}

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        u = float(data.ctrl[1])
        x, w = state.setdefault("x", u), state.setdefault("w", 0.0)
        side = 1.0 if u >= x else -1.0
        best = -np.inf
        for change in np.linspace(-1.0, 1.0, 41) * acceleration * H:
            then = side * (w + change)
            stops = side * (u - x - (w + change) * H) - 0.5 * then * then / acceleration
            fits = then <= speed + 1e-12 and (then <= 0.0 or stops >= 0.0)
            if fits and then > best:
                best, w_next = then, w + change
        state["w"] = w_next if best > -np.inf else w - side * acceleration * H
        state["x"] = x + state["w"] * H
        data.ctrl[1] = state["x"]

    return hook


def at_com(model: mujoco.MjModel, data: mujoco.MjData, force: Array) -> None:
    data.xfrc_applied[model.body("b2").id, :3] += force


def constant() -> Hook:
    return lambda m, d: at_com(m, d, np.array([3.0, -2.0, 4.0]))


def dragged() -> Hook:
    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        jacobian = np.zeros((3, 3))
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacBodyCom(model, data, jacobian, None, model.body("b2").id)
        v = jacobian @ data.qvel
        at_com(model, data, -2.5 * np.linalg.norm(v) * v)

    return hook


def tethered() -> Hook:
    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        body = model.body("b3").id
        x = data.xpos[body]
        force = 20.0 * (np.array([0.2, 0.3, 0.9]) - x)
        mujoco.mj_applyFT(model, data, force, np.zeros(3), x, body, data.qfrc_applied)

    return hook


def carrying(body_ends: str, position: str) -> str:
    weight = f'<body pos="{position}"><geom type="sphere" size="0.001" mass="0.5"'
    weight += ' contype="0" conaffinity="0"/></body>'
    return edited((body_ends, f"{body_ends}{weight}"))


def sliding(body_ends: str, position: str, reach: float, damping: float, stiffness: float) -> str:
    load = f'<body pos="{position}"><joint name="rail" type="slide" axis="1 0 0"'
    load += f' damping="{damping}" stiffness="{stiffness}" range="{-reach} {reach}"'
    load += ' limited="true"'
    load += ' solreflimit="0.006 0.6"/><geom type="sphere" size="0.001" mass="0.5"'
    load += ' contype="0" conaffinity="0"/></body>'
    return edited((body_ends, f"{body_ends}{load}"))


G1 = '<geom name="g1" type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>'
G2 = '<geom name="g2" type="box" pos="0.12 0.02 0.01" size="0.12 0.03 0.02" mass="0.8"/>'
TILT = (9.81 * np.sin(0.1) * np.cos(0.7), 9.81 * np.sin(0.1) * np.sin(0.7), -9.81 * np.cos(0.1))


def pushed() -> Hook:
    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if 0.8 <= data.time < 1.1:
            at_com(model, data, np.array([3.0, -2.0, 4.0]))

    return hook


def nudged() -> Hook:
    """Two newton metres on j1 for .3 s, with flanks of .05 s."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        up, down = np.tanh((data.time - 0.8) / 0.05), np.tanh((data.time - 1.1) / 0.05)
        data.qfrc_applied[1] += 2.0 * (up - down) / 2.0

    return hook


# -- what is recorded of j1 is not what it does


def sensed(q: Callable[[Array], Array], rates: Callable[[Array], Array]) -> Callable[[Run], Run]:
    """Another encoder of j1: what it makes of positions, and of velocities and accelerations."""

    def record(run: Run) -> Run:
        changed = [x.copy() for x in (run.q, run.v, run.a)]
        for x, law in zip(changed, (q, rates, rates), strict=True):
            x[:, 1] = law(x[:, 1])
        return replace(run, q=changed[0], v=changed[1], a=changed[2])

    return record


def shifted(offset: float) -> Callable[[Run], Run]:
    return sensed(lambda q: q + offset, lambda v: v)


def scaled(factor: float) -> Callable[[Run], Run]:
    return sensed(lambda q: factor * q, lambda v: factor * v)


def stepped(step: float) -> Callable[[Run], Run]:
    return sensed(lambda q: step * np.floor(q / step + 0.5), lambda v: v)


def later(delay: float) -> Callable[[Run], Run]:
    k = round(delay / H)

    def law(x: Array) -> Array:
        return np.concatenate([np.full(k, x[0]), x[:-k]])

    return sensed(law, law)


# -- what the outer links touch

LEVEL = 0.42
"""Height of a table or floor that the last link runs into [m]."""
_TOUCHING = (
    ('mass="0.8"', 'mass="0.8" conaffinity="3"{}'),
    ('<geom name="g3" type="sphere" size="0.02" mass="0.1"', (
        '<geom name="g3" type="sphere" size="0.02" mass="0.1" conaffinity="3"{}')),
)  # fmt: skip
_TABLE = f'<worldbody><geom name="table" type="box" size="1 1 0.1" pos="0 0 {LEVEL - 0.1}"'
_TABLE += ' contype="2" conaffinity="0" friction="0.3" solref="0.008 1" priority="2"/>'
BEFORE_TABLE = edited(("<worldbody>", _TABLE), *((old, new.format("")) for old, new in _TOUCHING))


def floored(
    friction: str = "0.8", solref: str = "0.02 1", zaxis: str = "0 0 1", height: float = LEVEL
) -> str:
    """The arm over a floor that its outer links touch; they are made of the same as the floor."""
    made_of = f' friction="{friction}" solref="{solref}"'
    floor = f'<worldbody><geom name="floor" type="plane" size="3 3 0.1" pos="0 0 {height}"'
    floor += f' zaxis="{zaxis}" contype="2" conaffinity="0"{made_of}/>'
    return edited(("<worldbody>", floor), *((old, new.format(made_of)) for old, new in _TOUCHING))


FALLING = (np.sin(0.2) * np.cos(0.7), np.sin(0.2) * np.sin(0.7), np.cos(0.2))
"""Normal of a plane that falls by 0.2 rad towards 0.7 rad."""
