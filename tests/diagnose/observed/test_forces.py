"""Measured forces and further sensors, against worlds stepped by plain MuJoCo."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import RATE, REFINE, STEP, chain
from wt.data.recording import check_against
from wt.diagnose.evidence import MeasuredForce, SensorError
from wt.diagnose.observed.forces import measured, sentence
from wt.diagnose.pipeline import diagnose
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.report.page import text
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.holdout import prepare_holdout
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

Array = np.ndarray
Columns = dict[str, Array]

NOISE = {"qpos": 2e-5, "qvel": 2e-3, "force": 0.02, "gyro": 1e-3, "acc": 0.05, "enc": 2e-5}
# the sensor's noise, and what half a step of the recorder's makes of position and acceleration
LEFT = {"gyro": 1.3e-3, "acc": 0.11, "enc": 4e-4}
SENSORS = """<sensor>
  <gyro name="gyro" site="tip"/><accelerometer name="acc" site="tip"/>
  <jointpos name="enc" joint="j1"/><actuatorfrc name="amp" actuator="a1"/>
  <force name="wrist" site="tip"/><touch name="skin" site="tip"/>
</sensor>"""
XML = (
    chain(2)
    .replace('damping=".3"', 'damping=".3" armature=".05"')
    .replace('mass="1.05"/>', 'mass="1.05"/><site name="tip" pos="0 0 -.2"/>')
    .replace("</mujoco>", f"{SENSORS}</mujoco>")
)
J1, J2 = Location("joint", "j1"), Location("joint", "j2")


@functools.cache
def record(xml: str, seed: int, seconds: float = 12.0) -> Recording:
    """Follow a multisine; every sensor of the MJCF and every actuator's force is recorded."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    n = int(seconds * RATE)
    t = np.arange(n) / RATE
    f, phase = rng.uniform(0.1, 0.8, (4, model.nu)), rng.uniform(0.0, 6.28, (4, model.nu))
    u = 0.4 + 0.3 * np.sin(2 * np.pi * t[:, None, None] * f + phase).sum(axis=1)
    rows: dict[str, list[float]] = {}
    for k in range(-RATE, n):
        if k >= 0:
            # a sample is read while the command of before still acts
            mujoco.mj_forward(model, data)
            values = {"qpos/j": data.qpos, "qvel/j": data.qvel, "force/a": data.actuator_force}
            for group, both in values.items():
                for i, x in enumerate(both):
                    rows.setdefault(f"{group}{i + 1}", []).append(float(x))
            for i in range(model.nsensor):
                s = model.sensor(i)
                for c in range(int(s.dim[0])):
                    x = data.sensordata[int(s.adr[0]) + c]
                    rows.setdefault(f"sensor/{s.name}/{c}", []).append(float(x))
        data.ctrl[:] = u[max(k, 0)]
        mujoco.mj_step(model, data, REFINE)
    columns = {f"ctrl/a{i + 1}": u[:, i] for i in range(model.nu)}
    for name, column in rows.items():
        kind = name.split("/")[1] if name.startswith("sensor/") else name.split("/")[0]
        columns[name] = np.array(column) + NOISE.get(kind, 0.0) * rng.standard_normal(n)
    return Recording(t, columns)


@dataclass
class Seen:
    forces: dict[str, MeasuredForce]
    sensors: dict[str, SensorError]
    notes: tuple[str, ...]


def seen(
    folder: Path,
    truth: str,
    hypothesis: Hypothesis = (),
    change: Callable[[Columns], None] = lambda columns: None,
    mismatch: bool = True,
) -> Seen:
    """What is measured in the world of one MJCF says to a user who believes in ``XML``."""
    path = folder / "arm.xml"
    path.write_text(XML, encoding="utf-8")
    scene = Scene(path)
    recordings = []
    for seed in (0, 1):
        recording = record(truth, seed)
        columns = dict(recording.columns)
        change(columns)
        recordings.append(Recording(recording.t, columns))
        check_against(recordings[-1], scene.model)
    prepared = prepare(scene, recordings[:1], recordings[1:])
    held = prepare_holdout(smooth(scene, prepared.held), True)
    screen = Screen(smooth(scene, prepared.fit), 0)
    found = measured(prepared, screen, held, hypothesis, STEP, mismatch)
    return Seen(
        {f.actuator: f for f in found.forces}, {s.name: s for s in found.sensors}, found.notes
    )


def planted(effect: str, at: Location, theta: Sequence[float]) -> Hypothesis:
    return (Planted(effects()[effect], at, np.array(theta)),)


FRICTION = XML.replace('axis="0 0 1" damping=".3"', 'axis="0 0 1" damping=".9"')
STIFF = XML.replace('axis="0 1 0" damping=".3"', 'axis="0 1 0" damping=".9"')
WEAK = XML.replace('joint="j2" kp="70" kv="3.5"', 'joint="j2" kp="56" kv="2.8"')
BOTH = FRICTION.replace('joint="j2" kp="70" kv="3.5"', 'joint="j2" kp="49" kv="2.45"')


def scale(factor: float) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        columns["force/a2"] = factor * columns["force/a2"]

    return change


@pytest.mark.parametrize(
    ("truth", "factor", "side"),
    [
        (FRICTION, 1.0, "behind"), (FRICTION, 1.08, "behind"), (WEAK, 1.0, "drive"),
        (BOTH, 1.0, "both"), (XML, 1.4, "measurement"), (XML, -1.0, "measurement"),
        (XML, 1.0, "neither"),
    ],
)  # fmt: skip
def test_a_measured_force_tells_the_drive_from_what_is_behind_it(
    tmp_path: Path, truth: str, factor: float, side: str
) -> None:
    found = seen(tmp_path, truth, change=scale(factor))
    force = found.forces["a2"]
    assert force.side == side, force
    assert (force.joint, force.moves, force.unit) == ("j2", ("link2",), "N·m")
    assert found.forces["a1"].side == "neither", found.forces["a1"]
    about = [n for n in found.notes if "actuator" in n]
    assert len(about) == (side != "neither")
    if side in ("drive", "behind"):
        assert (
            f"what is missing at joint j2 lies {'in' if side == 'drive' else 'behind'} the drive"
            in about[0]
        )


def test_a_force_tells_no_side_of_what_replays_do_not_miss(tmp_path: Path) -> None:
    """As on legs, where the ground may supply any force that inverse dynamics lacks."""
    found = seen(tmp_path, BOTH, mismatch=False)
    assert {f.side for f in found.forces.values()} == {"neither"}
    assert not found.notes[:-1], "but for the sensor that is not compared"


def test_the_figures_are_those_of_the_hidden_law(tmp_path: Path) -> None:
    force = seen(tmp_path, FRICTION).forces["a2"]
    speed = record(FRICTION, 0).columns["qvel/j2"]
    # 0.6 N·m·s/rad of damping that the model lacks
    assert force.off_motion == pytest.approx(0.6 * float(np.std(speed)), rel=0.1)
    assert force.lacking == pytest.approx(force.off_motion, rel=0.1)
    assert force.off_law < 0.1 * force.off_motion


def test_a_force_with_gaps_counts_where_it_is_known(tmp_path: Path) -> None:
    def gaps(columns: Columns) -> None:
        columns["force/a2"] = np.array(columns["force/a2"])
        columns["force/a2"][300:900] = np.nan
        columns["force/a1"] = np.full(len(columns["force/a1"]), np.nan)
        del columns["force/a1"]

    found = seen(tmp_path, FRICTION, change=gaps)
    assert found.forces["a2"].side == "behind"
    assert "a1" not in found.forces


def test_replays_say_what_sensors_report_before_and_after(tmp_path: Path) -> None:
    found = seen(tmp_path, STIFF, planted("joint.friction_viscous", J1, [0.6])).sensors
    units = {name: s.unit for name, s in found.items()}
    assert units == {
        "force/a1": "N·m", "force/a2": "N·m", "gyro": "rad/s", "acc": "m/s²", "enc": "rad",
        "amp": "N·m", "wrist": "N",
    }  # fmt: skip
    for name, kind in (("gyro", "gyro"), ("enc", "enc"), ("acc", "acc")):
        sensor = found[name]
        assert sensor.after is not None
        assert sensor.after < (0.9 if name == "acc" else 0.4) * sensor.before, name
        assert sensor.after < LEFT[kind], name
    for name, least in (("force/a1", 0.5), ("amp", 0.5), ("wrist", 0.8)):
        after = found[name].after
        assert after is not None
        assert after < least * found[name].before, name


def test_a_sensor_that_motion_does_not_decide_is_named(tmp_path: Path) -> None:
    found = seen(tmp_path, XML)
    assert "skin" not in found.sensors
    (note,) = [n for n in found.notes if "Not compared" in n]
    assert note.endswith(": skin.")


def test_an_encoder_offset_is_seen_by_the_encoder_alone(tmp_path: Path) -> None:
    def shift(columns: Columns) -> None:
        columns["qpos/j1"] = columns["qpos/j1"] + 0.03
        columns["sensor/enc/0"] = columns["sensor/enc/0"] + 0.03

    found = seen(tmp_path, XML, planted("sensor.offset", J1, [0.03]), shift).sensors
    for name in ("enc", "gyro"):
        after = found[name].after
        assert after is not None
        assert after < LEFT[name], name
    assert found["enc"].before > 0.01


def test_forces_are_not_told_where_a_replay_does_not_hold_them(tmp_path: Path) -> None:
    found = seen(tmp_path, XML, planted("joint.elasticity", J2, [400.0, 2.0, 0.0])).sensors
    assert found["force/a2"].after is None
    assert found["gyro"].after is not None


def test_nothing_measured_says_nothing(tmp_path: Path) -> None:
    def bare(columns: Columns) -> None:
        for name in [n for n in columns if n.startswith(("force/", "sensor/"))]:
            del columns[name]

    found = seen(tmp_path, FRICTION, change=bare)
    assert (found.forces, found.sensors, found.notes) == ({}, {}, ())


def test_every_side_has_its_sentence() -> None:
    for side in ("drive", "behind", "both", "measurement", "neither"):
        force = MeasuredForce("a", "j", (), 1.0, 2.0, 3.0, "N", side)
        assert bool(sentence(force)) == (side != "neither")


def test_a_diagnosis_has_it_and_its_json_stays(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    # one joint: a whole diagnosis in seconds
    single = (
        '<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody><body name="rod">'
        '<joint name="j1" axis="0 1 0" damping=".3" armature=".05"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1"/>'
        '<site name="tip" pos="0 0 -.3"/></body></worldbody>'
        '<actuator><position name="a1" joint="j1" kp="80" kv="4"/></actuator>'
        '<sensor><gyro name="gyro" site="tip"/></sensor></mujoco>'
    )
    path.write_text(single, encoding="utf-8")
    truth = single.replace('damping=".3"', 'damping=".9"')
    found = diagnose(path, [record(truth, 0, 5.0)], [record(truth, 1, 4.0)])
    assert [f.effect for f in found.findings] == ["joint.friction_viscous"]
    assert [f.side for f in found.measured.forces] == ["behind"]
    assert text.borne_out(found, found.findings[0]).endswith("bears this out.")
    assert any("behind the drive" in note for note in found.notes)
    gyro = next(s for s in found.measured.sensors if s.name == "gyro")
    assert gyro.after is not None
    assert gyro.after < 0.2 * gyro.before
    assert list(found.to_json()) == [
        "schema", "model", "recordings", "verdict", "locations", "findings", "fit",
        "audit", "decisions", "artifacts",
    ]  # fmt: skip
    assert {i.recording for p in found.locations for i in p.intervals} <= {"recording 1"}
