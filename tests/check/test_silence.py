"""Clean logs, and logs of robots with physics that the model lacks, give no line."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.check.machines import MACHINES, record, with_columns, write_model
from tests.physics import stool
from wt.check.run import check
from wt.physics.scene import Scene
from wt.types import Recording


def lines(name: str, recording: Recording, folder: Path) -> list[str]:
    checked = check(Scene(write_model(name, folder)), recording)
    return [f"{f.kind} {f.columns}: {f.evidence}" for f in checked.findings if f.sure]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", MACHINES)
def test_clean(name: str, seed: int, tmp_path: Path) -> None:
    assert not lines(name, record(name, 20 + seed), tmp_path)


ROBOTS = {
    "friction": lambda xml: xml.replace("damping=", 'frictionloss="0.6" damping='),
    "viscous": lambda xml: xml.replace('damping="0.', 'damping="1.'),
    "payload": lambda xml: xml.replace('".7"', '"1.5"').replace('mass=".35"', 'mass=".9"'),
    "gain": lambda xml: xml.replace('kp="60', 'kp="48').replace(
        'joint="knee"/>', 'joint="knee" gear=".8"/>'
    ),
    "rotor": lambda xml: xml.replace("damping=", 'armature="0.1" damping='),
    "spring": lambda xml: xml.replace("damping=", 'stiffness="3" damping='),
    "weak spring": lambda xml: xml.replace("damping=", 'stiffness=".6" springref="-.1" damping='),
    "tilt": lambda xml: xml.replace("<worldbody>", '<option gravity="1 0 -9.75"/><worldbody>'),
}  # fmt: skip


@pytest.mark.parametrize("name", ["planar", "planar_torque", "arm4", "rod"])
@pytest.mark.parametrize("missing", ROBOTS)
def test_missing_physics_is_no_fault(missing: str, name: str, tmp_path: Path) -> None:
    xml = MACHINES[name].xml
    if missing == "rotor":
        xml = re.sub(r' armature="[0-9.]+"', "", xml)
    recording = record(name, 30, robot=ROBOTS[missing](xml))
    assert not lines(name, recording, tmp_path)


@pytest.mark.parametrize("name", ["planar", "arm4", "planar_torque"])
def test_late_commands_are_no_fault(name: str, tmp_path: Path) -> None:
    r = record(name, 31)
    early = {n: np.append(c[2:], c[-1:].repeat(2)) for n, c in r.columns.items() if "ctrl" in n}
    assert not lines(name, with_columns(r, early), tmp_path)


@pytest.mark.parametrize("name", ["planar", "arm4"])
@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_one_drive_that_answers_early_is_no_fault_of_the_log(
    rate: float, name: str, tmp_path: Path
) -> None:
    """As one does whose firmware feeds the velocity of its command forward."""
    r = record(name, 9, rate=rate, seconds=6.0)
    column = next(n for n in r.columns if n.startswith("ctrl/"))
    sent = r.columns[column]
    late = with_columns(r, {column: np.concatenate([sent[:1], sent[:-1]])})
    assert not lines(name, late, tmp_path)


SPRUNG = """<mujoco><option timestep="0.001"/><worldbody><body pos="0 0 1">
<joint name="hinge" axis="0 1 0" damping="0.02"{}/>
<geom type="capsule" fromto="0 0 0 0 0 -.6" size=".02" mass=".8"/></body></worldbody>
<actuator><motor name="hinge_m" joint="hinge"/></actuator></mujoco>"""


@pytest.mark.parametrize(("seed", "lacking"), [(801, 'stiffness="3.9143"'), (801, 'stiffness="5"')])
def test_a_spring_stronger_than_the_weight_is_no_sign(
    seed: int, lacking: str, tmp_path: Path
) -> None:
    """It turns over the torque that holds a link, and explains that better than a sign does."""
    path = tmp_path / "m.xml"
    path.write_text(SPRUNG.format(""))
    m = mujoco.MjModel.from_xml_string(SPRUNG.format(f" {lacking}"))
    d, rng, t = mujoco.MjData(m), np.random.default_rng([seed, 7, 5]), np.arange(700) / 100
    rates = rng.uniform(0.15, 1.4, 5)
    wave = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6.3)) / (0.7 + f) for f in rates)
    wanted = 0.3 + 1.4 * wave / np.abs(wave).max()
    q, u = np.empty(len(t)), np.empty(len(t))
    d.qpos[0] = wanted[0]
    for k in range(len(t)):
        q[k], u[k] = d.qpos[0], 12.0 * (wanted[k] - d.qpos[0]) - 1.2 * d.qvel[0]
        d.ctrl[:] = u[max(k - 1, 0)]
        mujoco.mj_step(m, d, 10)
    q += 1e-4 * rng.standard_normal(len(q))
    assert not check(Scene(path), Recording(t, {"qpos/hinge": q, "ctrl/hinge_m": u})).findings


def test_small_offsets_and_scales_are_no_fault(tmp_path: Path) -> None:
    r = record("arm4", 32)
    off = with_columns(
        r, {"qpos/lift": r.columns["qpos/lift"] + 0.06, "qpos/bend": r.columns["qpos/bend"] * 1.04}
    )
    assert not lines("arm4", off, tmp_path)


def test_coarse_encoders_and_lost_samples_are_no_fault(tmp_path: Path) -> None:
    r = record("arm4", 33, seconds=6.0)
    lost = np.random.default_rng(0).random(len(r)) < 0.02
    step = 2 * np.pi / 4096
    coarse = {
        n: np.where(lost, np.nan, np.round(c / step) * step)
        for n, c in r.columns.items()
        if n.startswith("qpos")
    }
    assert not lines("arm4", with_columns(r, coarse), tmp_path)


def told(factor: float) -> Recording:
    """A stool on its feet whose knee moves ``factor`` times less than it is told."""
    r = stool.recording(1, seconds=5.0)
    q = r.columns["qpos/rear_knee"]
    command = q.mean() + factor * (q - q.mean())
    return with_columns(r, {"ctrl/rear_knee": command})


@pytest.mark.parametrize(("factor", "said"), [(4.0, 0), (40.0, 1)])
def test_a_soft_servo_under_a_load_is_no_gear(factor: float, said: int, tmp_path: Path) -> None:
    """What its feet bear nobody measured; that it is more than the machine weighs is no load."""
    checked = check(stool.scene(tmp_path), told(factor))
    assert len([f for f in checked.findings if f.kind.endswith("_scale")]) == said
