"""Held-out errors in plain MuJoCo, against worlds whose model is known."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.physics.quiet import quiet
from wt.prove import replay
from wt.prove.cases import Case, HiddenEffect
from wt.prove.sensing import Sensing
from wt.prove.world import HiddenWorld, build
from wt.types import Recording

SENSING = Sensing(rate=200.0, bits=18, noise=2e-5, qvel="none")


@functools.cache
def world(
    effect: str, kind: str, place: str, rig: str = "pendulum", **parameters: object
) -> HiddenWorld:
    truth = HiddenEffect(effect, kind, place, dict(parameters), effect)
    return build(Case("x", rig, 3, "single", (truth,), SENSING, ("triangle", "chirp"), 5.0))


def error(world: HiddenWorld, xml: str, findings: list[dict[str, object]] | None = None) -> float:
    """Error of a model's replay of the held-out recording [rad]."""
    given = mujoco.MjModel.from_xml_string(world.nominal_xml)
    measured = replay.measure(world.holdout[0], given)
    model = mujoco.MjModel.from_xml_string(xml)
    difference = replay.replay(model, measured, findings or []) - measured.q
    assert np.isfinite(difference).mean() > 0.8
    return float(np.sqrt(np.nanmean(difference**2)))


def test_the_right_friction_explains_a_servo() -> None:
    hidden = world("joint.friction_coulomb", "joint", "hinge", coulomb=0.6)
    right = hidden.nominal_xml.replace("<joint name=", '<joint frictionloss="0.6" name=')
    plain = error(hidden, hidden.nominal_xml)
    assert plain > 0.01
    # the rod's mass is a few per cent off
    assert error(hidden, right) < 0.25 * plain


def test_a_motor_is_replayed_in_windows() -> None:
    hidden = world("joint.friction_coulomb", "joint", "hinge", "pendulum_motor", coulomb=0.3)
    given = mujoco.MjModel.from_xml_string(hidden.nominal_xml)
    assert not replay.measure(hidden.holdout[0], given).servoed
    right = hidden.nominal_xml.replace("<joint name=", '<joint frictionloss="0.3" name=')
    assert error(hidden, right) < 0.2 * error(hidden, hidden.nominal_xml)


def test_what_a_file_beside_the_model_says_acts(tmp_path: Path) -> None:
    hidden = world("joint.friction_coulomb", "joint", "hinge", coulomb=0.6)
    (tmp_path / "robot.xml").write_text(hidden.nominal_xml)
    (tmp_path / "physics.py").write_text(
        "import mujoco\n\n\nclass Physics:\n"
        "    def __init__(self, model, recording):\n"
        "        self.model, self.known = model, recording != -1\n\n"
        "    def reset(self, data):\n"
        "        self.known = self.known or data.ctrl[0] != 0.0\n\n"
        "    def step(self, data):\n"
        "        self.model.dof_frictionloss[0] = 0.6 * self.known\n"
        "        mujoco.mj_step(self.model, data)\n"
    )
    given = mujoco.MjModel.from_xml_string(hidden.nominal_xml)
    measured = [replay.measure(hidden.holdout[0], given)]
    plain = replay.rmse(tmp_path / "robot.xml", measured)
    beside = replay.rmse(tmp_path / "robot.xml", measured, (), tmp_path / "physics.py")
    assert beside < 0.25 * plain


def test_filters_and_delays_find_their_state() -> None:
    """Both start at zero in MuJoCo, and are led to where they belong."""
    for effect, attributes in (
        ("actuator.delay", 'delay="0.03" nsample="40"'),
        ("actuator.lag", 'timeconst="0.03"'),
    ):
        name = effect.partition(".")[2].replace("lag", "time_constant")
        hidden = world(effect, "actuator", "hinge_drive", **{name: 0.03})
        right = hidden.nominal_xml.replace("<position ", f"<position {attributes} ")
        right = right.replace('timestep="0.002"', 'timestep="0.001"')
        assert error(hidden, right) < 0.15 * error(hidden, hidden.nominal_xml), effect


def test_a_rotor_starts_where_its_joint_is() -> None:
    xml = """
    <mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/><geom size=".1"/></body>
    <body><joint name="rotor" axis="0 1 0"/><geom size=".01" mass=".1"/></body></worldbody>
    <tendon><fixed name="gear"><joint joint="rotor" coef="1"/><joint joint="hinge" coef="-5"/>
    </fixed></tendon></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    assert replay._tied(model, ["hinge"]) == {1: (0, 5.0)}
    assert replay._tied(model, ["hinge", "rotor"]) == {}


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        ("sensor.offset", {"offset": 0.1}),
        ("sensor.scale", {"factor": 1.1}),
        ("sensor.delay", {"delay": 0.02}),
    ],
)
def test_what_sensors_do_is_done(effect: str, parameters: dict[str, float]) -> None:
    hidden = world(effect, "joint", "hinge", **parameters)
    said = {name: {"value": value} for name, value in parameters.items()}
    finding = {"effect": effect, "at": {"kind": "joint", "name": "hinge"}, "parameters": said}
    plain = error(hidden, hidden.nominal_xml)
    assert error(hidden, hidden.nominal_xml, [finding]) < 0.2 * plain


def test_a_model_that_explodes_counts_as_one_radian() -> None:
    hidden = world("joint.friction_coulomb", "joint", "hinge", coulomb=0.6)
    wild = hidden.nominal_xml.replace('damping="0.05"', 'damping="-500"')
    with quiet():
        given = mujoco.MjModel.from_xml_string(hidden.nominal_xml)
        measured = replay.measure(hidden.holdout[0], given)
        found = replay.replay(mujoco.MjModel.from_xml_string(wild), measured)
    assert np.isinf(found).any()


def test_rmse_reads_files(tmp_path: Path) -> None:
    from wt.data import recording

    hidden = world("joint.friction_coulomb", "joint", "hinge", coulomb=0.6)
    (tmp_path / "robot.xml").write_text(hidden.nominal_xml)
    lost = hidden.holdout[0].columns["qpos/hinge"].copy()
    lost[100:200] = np.nan
    columns = dict(hidden.holdout[0].columns) | {"qpos/hinge": lost}
    recording.write(dataclasses.replace(hidden.holdout[0], columns=columns), tmp_path / "h.parquet")
    measured = replay.read(tmp_path / "robot.xml", [tmp_path / "h.parquet"])
    found = replay.rmse(tmp_path / "robot.xml", measured)
    assert found == pytest.approx(error(hidden, hidden.nominal_xml), rel=0.2)


def test_a_machine_without_drives_is_replayed_in_windows() -> None:
    """A rod that air brakes: the model that knows replays it, and another does not."""
    rod = (
        '<mujoco><option timestep="0.001"/><worldbody><body name="rod"><joint name="h" '
        'axis="0 1 0" damping="{}"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" '
        'mass=".5"/></body></worldbody></mujoco>'
    )
    true = mujoco.MjModel.from_xml_string(rod.format(0.02))
    data, angle = mujoco.MjData(true), []
    data.qpos[0] = 1.0
    for _ in range(400):
        angle.append(float(data.qpos[0]))
        mujoco.mj_step(true, data, 10)
    recording = Recording(np.arange(400) / 100.0, {"qpos/h": np.array(angle)}, {})
    other = mujoco.MjModel.from_xml_string(rod.format(0.0))
    measured = replay.measure(recording, other)
    assert measured.drives == () and measured.u.shape == (400, 0) and not measured.servoed
    errors = [np.nanstd(replay.replay(m, measured, []) - measured.q) for m in (true, other)]
    assert errors[0] < 0.2 * errors[1]
