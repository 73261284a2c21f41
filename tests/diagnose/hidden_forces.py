"""Recordings of chains with a hidden force, made by plain MuJoCo stepping and nothing of ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.holdout import Holdout, prepare_holdout
from wt.physics.scene import Scene
from wt.types import Recording

Array = np.ndarray
Hidden = Callable[[mujoco.MjModel, mujoco.MjData], None]
"""Adds to ``qfrc_applied`` or ``xfrc_applied`` before a step."""

NOISE, RATE, STEP, REFINE = 2e-5, 200, 5e-4, 10
AXES = ("0 1 0", "0 0 1", "0 1 0", "1 0 0", "0 1 0")


@dataclass
class World:
    """A machine, its recordings' weak residual and, for replays, an objective and held data."""

    scene: Scene
    screen: Screen
    objective: Objective
    held: Holdout


def chain(joints: int) -> str:
    """A hanging chain of ``joints`` servo-driven links: j1…, link1…, a1…."""
    bodies = "".join(
        f'<body name="link{i + 1}" pos="0 0 {-0.25 * (i > 0)}">'
        f'<joint name="j{i + 1}" axis="{AXES[i]}" damping=".3"/>'
        f'<geom type="capsule" fromto="0 0 0 .03 .02 -.25" size=".03" mass="{1.2 - 0.15 * i}"/>'
        for i in range(joints)
    )
    servos = "".join(
        f'<position name="a{i + 1}" joint="j{i + 1}" kp="{80 - 10 * i}" kv="{4 - 0.5 * i}"/>'
        for i in range(joints)
    )
    return (
        '<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>'
        f"<worldbody>{bodies}{'</body>' * joints}</worldbody><actuator>{servos}</actuator></mujoco>"
    )


def record(
    xml: str, hidden: Hidden | None, seconds: float, seed: int, swing: float = 0.3
) -> Recording:
    """Follow a multisine with a hidden force; position and velocity noise added."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    n, nv = int(seconds * RATE), model.nv
    t = np.arange(n) / RATE
    f, phase = rng.uniform(0.1, 0.8, (4, nv)), rng.uniform(0.0, 6.28, (4, nv))
    u = 0.4 + swing * np.sin(2 * np.pi * t[:, None, None] * f + phase).sum(axis=1)
    q, v = np.empty((n, nv)), np.empty((n, nv))
    applied, pushed = data.qfrc_applied, data.xfrc_applied
    # settle under the first command
    for k in range(-RATE, n):
        data.ctrl[:] = u[max(k, 0)]
        if k >= 0:
            q[k], v[k] = data.qpos, data.qvel
        if hidden is None:
            mujoco.mj_step(model, data, REFINE)
            continue
        for _ in range(REFINE):
            applied[:], pushed[:] = 0.0, 0.0
            data.time = max(k, 0) / RATE
            hidden(model, data)
            mujoco.mj_step(model, data)
    q, v = q + NOISE * rng.standard_normal(q.shape), v + 2e-3 * rng.standard_normal(v.shape)
    columns = {f"qpos/j{j + 1}": q[:, j] for j in range(nv)}
    columns |= {f"qvel/j{j + 1}": v[:, j] for j in range(nv)}
    columns |= {f"ctrl/a{j + 1}": u[:, j] for j in range(nv)}
    return Recording(t, columns)


def world(
    folder: Path,
    joints: int,
    hidden: Hidden | None,
    seconds: float = 12.0,
    fitted: int = 1,
    log: Callable[[Recording], Recording] = lambda recording: recording,
    machine: str = "",
    model: str = "",
) -> World:
    """Recordings of a chain: ``fitted`` ones, and one more that is held out.

    ``log`` alters all of them; ``machine`` is the MJCF of the real chain, and ``model`` the one
    that is given, where they are others.
    """
    path = folder / "chain.xml"
    path.write_text(model or chain(joints), encoding="utf-8")
    scene = Scene(path)
    xml = machine or chain(joints)
    made = [log(record(xml, hidden, seconds, seed)) for seed in range(fitted + 1)]
    # clocks are never the same to the last digit
    parts = [Part(replace(one, t=one.t * (1.0 + 1e-12 * i)), i) for i, one in enumerate(made)]
    fit, held = smooth(scene, parts[:-1]), smooth(scene, parts[-1:])
    screen = Screen(fit, 0)
    objective = Objective(fit, stretches_of(fit, True), STEP, True)
    return World(scene, screen, objective, prepare_holdout(held, True))


def on_joint(dof: int, law: Callable[[float, float], float]) -> Hidden:
    """A force of position and velocity of a joint on that joint."""

    def push(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[dof] += law(float(data.qpos[dof]), float(data.qvel[dof]))

    return push
