"""An effect is the same one however the file is written, simulated and read back alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.truths import TRUTHS, Truth
from tests.physics.ways import written
from wt.mjcf.edit import _REWRITTEN, patched_xml
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.rotor import GearEffect
from wt.physics.scene import Scene
from wt.types import Location

JOINTS = ("j0", "j1", "j2")
STEPS = 30
FIRST = list({t.id: t for t in reversed(TRUTHS)}.values())
# a gear at the foot of the machine, too, whose stand may be fused with the world
GEARS = [
    replace(t, at=Location("joint", "j0")) for t in FIRST if isinstance(effects()[t.id], GearEffect)
]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scene]:
    files = written(tmp_path_factory.mktemp("ways"))
    return {way: Scene(path) for way, path in files.items()}


def moved(model: mujoco.MjModel, touching: bool = False) -> np.ndarray:
    """Path of the arm's joints, (steps, 3), from a level pose or from one just above the floor."""
    data, path = mujoco.MjData(model), []
    names = [model.joint(j).name.removeprefix("a_") for j in range(model.njnt)]
    for name, q in zip(names, model.jnt_qposadr, strict=True):
        if name.startswith("j1"):  # its rotor, if there is one, starts with it
            data.qpos[q] = 0.3 if touching else 0.0
    own = [model.jnt_qposadr[names.index(name)] for name in JOINTS]
    for k in range(STEPS):
        data.ctrl[:3] = 0.5 * np.sin(0.1 * k), 0.5, 0.4 * np.cos(0.2 * k)
        mujoco.mj_step(model, data)
        path.append(data.qpos[own])
    return np.array(path)


def test_the_machine_is_the_same_one(scenes: dict[str, Scene]) -> None:
    for touching in (False, True):
        plain = moved(scenes["plain"].model, touching)
        assert np.ptp(plain, axis=0).min() > 1e-3
        for way, scene in scenes.items():
            path = moved(scene.model, touching)
            np.testing.assert_allclose(path, plain, atol=1e-11, err_msg=way)


def place(at: Location, way: str) -> Location:
    """Where an effect is in a file that may have other names, of a machine without a b3."""
    name = at.name.replace("b3", "b2")
    own = name not in ("all", "floor", "world")
    if own and way == "unnamed" and at.kind == "actuator":
        name = name.replace("m", "actuator")
    if own and way == "attached":
        name = "+".join(f"a_{part}" for part in name.split("+"))
    return Location(at.kind, name)


@pytest.mark.parametrize("truth", [*FIRST, *GEARS], ids=lambda t: f"{t.id}-{t.at.name}")
def test_an_effect_moves_it_alike(truth: Truth, scenes: dict[str, Scene], tmp_path: Path) -> None:
    effect, theta = effects()[truth.id], np.array(truth.theta)
    touching, expected = truth.id.startswith("contact."), None
    if truth.id == "contact.slope":
        theta = 0.1 * theta  # no floor that lifts the machine up
    for way, scene in scenes.items():
        spec, at = scene.spec(), place(truth.at, way)
        effect.patch(spec, at, theta)
        path = moved(spec.compile(), touching)
        expected = path if expected is None else expected
        np.testing.assert_allclose(path, expected, atol=1e-9, err_msg=f"{way}, simulated")
        text = patched_xml(scene, (Planted(effect, at, theta),), ("found",))
        file = tmp_path / "model.xml"
        file.write_text(text)
        again = moved(mujoco.MjModel.from_xml_path(str(file)), touching)
        np.testing.assert_allclose(again, expected, atol=1e-9, err_msg=f"{way}, written")
        assert _REWRITTEN not in text or way == "attached", f"{way} is written anew"
