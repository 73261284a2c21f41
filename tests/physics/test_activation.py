"""Drives with dynamics of their own: filters and integrators, as MuJoCo has them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.pipeline import diagnose
from wt.physics.activation import activated, following
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location, Recording

STEP, EVERY = 5e-4, 20
DRIVES = {
    "filtered": '<position name="a" joint="j" kp="20" kv="1" timeconst=".08" ctrlrange="-.4 .4"/>',
    "euler": '<general name="a" joint="j" dyntype="filter" dynprm=".05" gainprm="2"/>',
    "rate": '<intvelocity name="a" joint="j" kp="20" kv="1" ctrlrange="-2 2" actrange="-.6 .5"/>',
    "direct": '<motor name="a" joint="j" ctrlrange="-2 2"/>',
}


def machine(drive: str, friction: float = 0.0) -> str:
    return (
        f'<mujoco><option timestep="{STEP}" integrator="implicitfast"/><worldbody><body>'
        f'<joint name="j" axis="0 1 0" damping=".1" frictionloss="{friction}"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass=".8"/></body></worldbody>'
        f"<actuator>{DRIVES[drive]}</actuator></mujoco>"
    )


def run(xml: str, seconds: float, start: float = 0.0) -> dict[str, np.ndarray]:
    """Samples at 100 Hz of a machine under held commands; the drive's activation, too."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, n = mujoco.MjData(model), round(seconds / (STEP * EVERY))
    t = np.arange(n) * STEP * EVERY
    size = (
        0.16 if "timeconst" in xml else 1.0
    )  # of positions, where the others are speeds and torques
    u = size * (1.5 * np.sin(5.0 * t) + np.sin(13.0 * t + 0.7))
    out = {"t": t, "u": u[:, None], "act": np.empty((n, 1)), "q": np.empty(n), "v": np.empty(n)}
    if model.na:
        data.act[0] = start if drive_rates(model) else np.clip(u[0], *_range(model))
    for k in range(n):
        data.ctrl[0] = u[k]
        out["act"][k] = data.act if model.na else u[k]
        out["q"][k], out["v"][k] = data.qpos[0], data.qvel[0]
        mujoco.mj_step(model, data, EVERY)
    return out


def drive_rates(model: mujoco.MjModel) -> bool:
    return int(model.actuator_dyntype[0]) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR)


def _range(model: mujoco.MjModel) -> np.ndarray:
    limited = bool(model.actuator_ctrllimited[0])
    return model.actuator_ctrlrange[0] if limited else np.array([-np.inf, np.inf])


@pytest.mark.parametrize("drive", DRIVES)
def test_activations_are_those_of_mujoco(drive: str) -> None:
    model = mujoco.MjModel.from_xml_string(machine(drive))
    made = run(machine(drive), 3.0, start=0.2)
    acted = activated(model, made["t"], made["u"], np.array([0.2]))
    # MuJoCo's plain filter is stepped by Euler
    error = 2e-2 if drive == "euler" else 1e-9
    assert acted == pytest.approx(made["act"], abs=error)


@pytest.mark.parametrize("drive", DRIVES)
def test_replays_go_on_from_where_drives_had_got_to(drive: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.xml"
    path.write_text(machine(drive))
    made = run(machine(drive), 2.0)
    rows = slice(70, 150)
    stretch = Stretch(
        0, made["t"][rows], made["u"][rows], made["q"][rows][:1], made["v"][rows][:1],
        made["act"][70],
    )  # fmt: skip
    q = Replayer(Scene(path), [stretch], STEP).run([()]).q[0]
    assert np.abs(q[:, 0] - made["q"][rows]).max() < 2e-3 * np.ptp(made["q"])


@pytest.mark.long
def test_friction_behind_an_integrator_is_found(tmp_path: Path) -> None:
    path = tmp_path / "machine.xml"
    path.write_text(machine("rate"))
    made = run(machine("rate", 0.3), 5.0, start=0.2)
    noisy = made["q"] + 2e-4 * np.random.default_rng(0).standard_normal(len(made["q"]))
    found = diagnose(path, [Recording(made["t"], {"ctrl/a": made["u"][:, 0], "qpos/j": noisy})])
    named = [(f.effect, f.parameters["coulomb"].value) for f in found.findings]
    assert named == [("joint.friction_coulomb", pytest.approx(0.3, rel=0.1))]
    # a setpoint moves in the half physics step by which commands come late; friction hides its zero
    assert found.proof.holdout.after < 3e-3


def test_late_commands_of_before_arrive_in_a_replay(tmp_path: Path) -> None:
    path, xml = tmp_path / "machine.xml", machine("direct")
    path.write_text(xml)
    model = mujoco.MjModel.from_xml_string(xml)
    data, n, rng = mujoco.MjData(model), 120, np.random.default_rng(0)
    u, t = rng.uniform(-1.0, 1.0, n), np.arange(n) * STEP * EVERY
    q, v = np.empty((2, n))
    for k in range(n):
        data.ctrl[0], q[k], v[k] = u[max(k - 2, 0)], data.qpos[0], data.qvel[0]
        mujoco.mj_step(model, data, EVERY)
    late = Planted(effects()["actuator.delay"], Location("actuator", "a"), np.array([0.02]))
    first = 40
    begun = Stretch(0, t[first:], u[first:, None], q[first : first + 1], v[first : first + 1])
    led = replace(begun, lead_t=t[20:first], lead=u[20:first, None])
    replayed = Replayer(Scene(path), [begun, led], STEP).run([(late,)]).q[0][:, 0]
    errors = [np.abs(x - q[first:]).max() for x in np.split(replayed, 2)]
    assert errors[1] < 0.2 * errors[0]


def test_what_becomes_of_a_command_is_an_activation_but_no_integral() -> None:
    drives = """<position joint="j" kp="5"/><position joint="j" kp="5" timeconst=".1"/>
    <pid joint="j" kp="5" ki="3" input="pos"/><pid joint="j" kp="5" slewmax="2" input="pos"/>
    <pid joint="j" kp="5" ki="3" slewmax="2" input="pos"/>"""
    xml = f"""<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1"/></body>
    </worldbody><actuator>{drives}</actuator></mujoco>"""
    assert following(mujoco.MjModel.from_xml_string(xml)).tolist() == [1, 3, 4]
