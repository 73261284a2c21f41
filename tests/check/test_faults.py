"""Each fault of a log is said, at its column and no other, and mended; two at once too."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.check.faults import FAULTS, both
from tests.check.machines import MACHINES, Fault, record, with_columns, write_model
from tests.physics import stool
from wt.check.run import Checked, check
from wt.physics.scene import Scene
from wt.types import Recording


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scene]:
    folder = tmp_path_factory.mktemp("models")
    return {name: Scene(write_model(name, folder)) for name in MACHINES}


@pytest.fixture(scope="module")
def checked(scenes: dict[str, Scene]) -> Callable[[Fault], Checked]:
    """What is said of a faulty log, once: most are also mended."""
    kept: dict[str, Checked] = {}

    def of(fault: Fault) -> Checked:
        if fault.id not in kept:
            kept[fault.id] = check(scenes[fault.machine], fault.log())
        return kept[fault.id]

    return of


def said(checked: Checked) -> set[tuple[str, frozenset[str]]]:
    return {(f.kind, frozenset(f.columns)) for f in checked.findings if f.sure}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.id)
def test_a_fault_is_said(fault: Fault, checked: Callable[[Fault], Checked]) -> None:
    assert said(checked(fault)) == {(fault.kinds[0], fault.columns)}


EXACT = [f for f in FAULTS if f.id.startswith(("sign", "swap", "degrees", "ms", "wrap", "comm"))]
MENDED = [*EXACT[::3], *(f for f in FAULTS if f.id.startswith("cycle"))]


@pytest.mark.parametrize("fault", MENDED, ids=lambda f: f.id)
def test_a_mended_log_is_as_it_was(fault: Fault, checked: Callable[[Fault], Checked]) -> None:
    clean = record(fault.machine, fault.seed, **fault.options)  # type: ignore[arg-type]
    mended = checked(fault).recording
    assert mended is not None
    np.testing.assert_allclose(mended.t, clean.t, atol=1e-9)
    for name, column in clean.columns.items():
        np.testing.assert_allclose(mended.columns[name], column, atol=1e-6, err_msg=name)


PAIRS = [
    ("sign-arm4-lift", "degrees-arm4-yaw"),
    ("sign-planar-knee", "command-sign-planar-hip"),
    ("swap-arm4-lift-bend", "velocity-degrees"),
    ("ms-planar", "sign-planar-hip"),
    ("sign-gantry-rail", "degrees-gantry-swing"),
    ("wrap-arm4-yaw", "sign-arm4-lift"),
]


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_two_faults_are_said(pair: tuple[str, str], scenes: dict[str, Scene]) -> None:
    known = {f.id: f for f in FAULTS}
    one, other = (known[name] for name in pair)
    assert one.machine == other.machine
    found = said(check(scenes[one.machine], both(one, other)))
    assert found == {(f.kinds[0], f.columns) for f in (one, other)}


@pytest.mark.parametrize("seed", [0, 4])
def test_a_factor_is_fitted_behind_a_sign(seed: int, scenes: dict[str, Scene]) -> None:
    """Beside a sign a factor of 7.3 fits no better than one of 163: the sign is undone first."""
    r = record("arm4_torque", seed)
    back, scaled = (
        {f"{kind}/{joint}": factor * r.columns[f"{kind}/{joint}"] for kind in ("qpos", "qvel")}
        for joint, factor in (("lift", -1.0), ("bend", 7.3))
    )
    checked = check(scenes["arm4_torque"], with_columns(r, back | scaled))
    assert said(checked) == {
        ("encoder_sign", frozenset(back)),
        ("position_scale", frozenset(scaled)),
    }
    assert checked.recording is not None
    for name in (*back, *scaled):
        np.testing.assert_allclose(
            checked.recording.columns[name], r.columns[name], rtol=0.02, atol=0.02
        )


def test_a_leap_of_about_one_is_no_turn() -> None:
    """What goes on after a leap as it went on before went round; this did not."""
    t = np.arange(400) / 100
    column = np.where(t < 2.0, -0.45 + 0.02 * np.sin(t), 0.45 + 0.02 * np.sin(t))
    assert not check(None, Recording(t, {"ctrl/a": column, "qpos/a": 0.2 * np.sin(t)})).findings


def test_the_rate_of_a_controller_is_not_guessed(checked: Callable[[Fault], Checked]) -> None:
    """Half a sample of lead tells that it is another one, and hardly which."""
    slow = next(f for f in FAULTS if f.id == "slow-log-arm4")
    (found,) = checked(slow).findings
    assert re.findall(r"[0-9]+", found.evidence) == ["25"]


@pytest.mark.parametrize("by", [math.pi, math.pi / 2])
def test_a_zero_is_mended_beside_what_the_load_does(by: float, scenes: dict[str, Scene]) -> None:
    clean = record("arm4", 12)
    off = with_columns(clean, {"qpos/lift": clean.columns["qpos/lift"] + by})
    mended = check(scenes["arm4"], off).recording
    assert mended is not None
    away = mended.columns["qpos/lift"] - clean.columns["qpos/lift"]
    assert np.abs(away).max() < 0.03


def test_an_encoder_is_told_from_a_command_or_both_are_said(tmp_path: Path) -> None:
    """About a vertical axis a force that is a fiftieth may be a position that is fifty times."""
    xml = MACHINES["rod"].xml.replace("0 1 0", "0 0 1")
    xml = re.sub("<position.*/>", '<motor name="hinge_m" joint="hinge"/>', xml)
    (tmp_path / "m.xml").write_text(xml)
    r = turned(xml)
    spoiled = with_columns(r, {"ctrl/hinge_m": 0.02 * r.columns["ctrl/hinge_m"]})
    scene = Scene(tmp_path / "m.xml")
    assert not check(scene, r).findings
    (found,) = check(scene, spoiled).findings
    assert "cannot be told" in found.evidence
    assert "ctrl/hinge_m" in found.evidence
    assert "qpos/hinge" in found.evidence
    assert found.confidence < 0.8


def turned(xml: str) -> Recording:
    """A motor that turns a joint to and fro."""
    m = mujoco.MjModel.from_xml_string(xml)
    d, t = mujoco.MjData(m), np.arange(600) / 100.0
    q, u = np.empty(600), np.empty(600)
    for k in range(600):
        goal = 0.9 * np.sin(2.0 * t[k]) + 0.4 * np.sin(5.3 * t[k])
        q[k], u[k] = d.qpos[0], 8.0 * (goal - d.qpos[0]) - 1.2 * d.qvel[0]
        d.ctrl[:] = u[k]
        mujoco.mj_step(m, d, 10)
    return Recording(t, {"qpos/hinge": q, "ctrl/hinge_m": u})


def test_limits_tell_an_encoder_from_a_command(tmp_path: Path) -> None:
    """A base that floats leaves a servo's law alone, in which the command may be wrong as well."""
    path, given = stool.scene(tmp_path).path, stool.recording(1, seconds=5.0)
    names = ("qpos/rear_knee", "qvel/rear_knee")
    q = given.columns[names[0]]
    spec = mujoco.MjSpec.from_file(str(path))
    joint = spec.joint("rear_knee")
    joint.limited, joint.range = True, [q.min() - 0.1, q.max() + 0.1]
    path.write_text(spec.to_xml())
    scaled = {name: 7.3 * given.columns[name] for name in names}
    (found,) = check(Scene(path), with_columns(given, scaled)).findings
    assert (found.kind, found.columns) == ("position_scale", names)
