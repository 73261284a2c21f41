"""The examples are what their script makes, small, and of machines that differ as is said."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

from wt import shipped
from wt.check.run import check
from wt.data.recording import check_against, read
from wt.diagnose.pipeline import diagnose
from wt.physics.effect import effects
from wt.physics.scene import Scene
from wt.types import Location

FOLDER = shipped.folder("examples")
NAMES = ("arm", "cart", "go2")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_examples", FOLDER / "make.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_recordings_are_of_the_model_and_answers_in_the_vocabulary(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(FOLDER / name / "model.xml"))
    for take in (1, 2):
        check_against(read(FOLDER / name / f"{take}.parquet"), model)
    (hidden,) = json.loads((FOLDER / name / "answer.json").read_text())["truth"]
    known = effects()[hidden["effect"]]
    assert {p.name for p in known.parameters} >= set(hidden["parameters"]) - {"position"}


@pytest.mark.parametrize("name", NAMES)
def test_an_audit_says_nothing_of_them(name: str) -> None:
    scene = Scene(FOLDER / name / "model.xml")
    for take in (1, 2):
        assert check(scene, read(FOLDER / name / f"{take}.parquet")).findings == ()


@pytest.mark.parametrize(("name", "joint"), [("arm", "shoulder"), ("cart", "rail")])
def test_they_move_as_far_as_they_are_told(name: str, joint: str) -> None:
    recording = read(FOLDER / name / "1.parquet")
    told, moved = (
        np.ptp(next(c for n, c in recording.columns.items() if n.startswith(kind)))
        for kind in ("ctrl/", f"qpos/{joint}")
    )
    assert 0.8 * told < moved < 1.2 * told


def test_they_are_less_than_a_megabyte() -> None:
    files = [f for f in FOLDER.rglob("*") if f.is_file() and "__pycache__" not in f.parts]
    assert sum(f.stat().st_size for f in files) < 1_000_000


def test_the_script_makes_them(script: ModuleType, tmp_path: Path) -> None:
    script.make(tmp_path)
    for name in NAMES:
        made = tmp_path / name
        for same in ("model.xml", "answer.json"):
            assert (made / same).read_text() == (FOLDER / name / same).read_text()
        for take in ("1.parquet", "2.parquet"):
            own, shipped_ = read(made / take), read(FOLDER / name / take)
            np.testing.assert_allclose(own.t, shipped_.t)
            for column, values in shipped_.columns.items():
                # a unit in the last place of a sum may turn a rounding of the encoder
                np.testing.assert_allclose(own.columns[column], values, atol=6e-3)


def test_the_hidden_cart_needs_its_friction_to_move(script: ModuleType) -> None:
    model = script.hidden_cart()
    data = mujoco.MjData(model)
    for force, moves in ((0.9 * script.FRICTION, False), (1.1 * script.FRICTION, True)):
        mujoco.mj_resetData(model, data)
        # a servo told to move by so much pushes with kp times that
        data.ctrl[:] = force / model.actuator_gainprm[0, 0]
        mujoco.mj_step(model, data, 4000)
        assert (abs(data.qpos[0]) > 1e-3) == moves


def test_the_hidden_load_weighs_what_is_said(script: ModuleType) -> None:
    given = mujoco.MjModel.from_xml_path(str(FOLDER / "go2" / "model.xml"))
    assert script.hidden_go2().body_mass.sum() - given.body_mass.sum() == pytest.approx(script.LOAD)


@pytest.mark.parametrize("name", ["arm", "cart", pytest.param("go2", marks=pytest.mark.long)])
def test_what_is_hidden_in_them_is_found(name: str) -> None:
    """The first thing that anybody tries; on legs it takes two minutes."""
    folder = FOLDER / name
    said = diagnose(folder / "model.xml", [folder / f"{take}.parquet" for take in (1, 2)])
    (hidden,) = json.loads((folder / "answer.json").read_text())["truth"]
    (found,) = said.findings
    assert said.verdict == "explained"
    assert found.effect == hidden["effect"]
    assert found.at == Location(hidden["at"]["kind"], hidden["at"]["name"])
    for parameter, true in hidden["parameters"].items():
        estimate = found.parameters[parameter]
        ends = np.reshape(estimate.ci95, (2, -1)).T
        for (low, high), value in zip(ends, np.atleast_1d(true), strict=True):
            assert low <= value <= high
