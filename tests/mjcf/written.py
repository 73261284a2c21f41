"""A hypothesis as it is written for the user, and run in plain MuJoCo: for tests."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from tests.physics.arm import ARM, JOINTS, Run, scene, simulate
from tests.physics.truths import Truth
from wt.mjcf.edit import patched_xml
from wt.mjcf.physics import physics_py
from wt.mjcf.template import Physics
from wt.physics.effect import effects
from wt.physics.hooks import shaped
from wt.physics.planted import Planted

_RUNS: dict[tuple[str, float], Run] = {}


def planted(truth: Truth) -> Planted:
    return Planted(shaped(effects()[truth.id], truth.shape), truth.at, np.array(truth.theta))


def write(folder: Path, hypothesis: Sequence[Planted], xml: str = ARM) -> Path:
    """``model.xml`` and, where it takes one, ``physics.py``."""
    of = scene(folder, xml)
    out = folder / "diagnosis"
    out.mkdir(exist_ok=True)
    text = patched_xml(of, tuple(hypothesis), [p.statement(of) for p in hypothesis])
    (out / "model.xml").write_text(text)
    (out / "physics.py").unlink(missing_ok=True)
    if (script := physics_py(of, tuple(hypothesis))) is not None:
        (out / "physics.py").write_text(script)
    return out


def load(folder: Path) -> tuple[mujoco.MjModel, Physics | None]:
    """The model, and its ``Physics`` or None."""
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    if not (folder / "physics.py").exists():
        return model, None
    made: Physics = module(folder / "physics.py").Physics(model)
    return model, made


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("written_physics", path)
    assert spec is not None and spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def drive(
    model: mujoco.MjModel, physics: Physics | None, run: Run, attached: bool = False
) -> np.ndarray:
    """Positions of the arm's joints that sensors report, (K, JOINTS), under the run's commands."""
    data, u = mujoco.MjData(model), 0.5 * (run.held + np.vstack([run.held[:1], run.held[:-1]]))
    joints = [model.joint(f"j{i}").qposadr[0] for i in range(JOINTS)]
    data.ctrl[:] = u[0]
    q, v = np.empty_like(run.q), np.empty_like(run.v)
    start = run.q[0], run.v[0]
    if physics is not None:
        start = physics.state(*start)
    data.qpos[joints], data.qvel[joints] = start
    if physics is not None:
        physics.reset(data)
        if attached:
            physics.attach()
    for k in range(len(run.t)):
        q[k], v[k], data.ctrl[:] = data.qpos[joints], data.qvel[joints], u[k]
        if physics is None or attached:
            mujoco.mj_step(model, data)
        else:
            physics.step(data)
    if physics is not None:
        physics.detach()
        q, _ = physics.sense(run.t, q, v)
    return q


def error(q: np.ndarray, run: Run) -> float:
    return float(np.sqrt(np.mean((q - run.q) ** 2)))


def unhidden(xml: str, seconds: float = 2.0) -> Run:
    if (xml, seconds) not in _RUNS:
        _RUNS[xml, seconds] = simulate(xml, seconds=seconds)
    return _RUNS[xml, seconds]
