"""The servo rigs against closed forms and what others published of them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.data.importers import base
from wt.errors import DataError
from wt.types import Recording
from wt.worlds import rigs

# model_parameters.yml of the double pendulum's model 1.0
M1, M2, L1, R1, R2 = 0.5234602302310271, 0.6255677234174437, 0.2, 0.2, 0.25569305436052964
I1, I2, ROTOR = 0.031887199591513114, 0.05086984812807257, 36 * 6.287203962819607e-05


def at(model: mujoco.MjModel, position: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Inertia matrix [kg·m²] and gravity torque [N·m] of a pose."""
    data = mujoco.MjData(model)
    data.qpos = position
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return inertia, data.qfrc_bias.copy()


@pytest.mark.parametrize("position", [[0.0, 0.0], [0.7, -1.3], [2.0, 0.4]])
@pytest.mark.parametrize("rotors", [True, False])
def test_double_pendulum_equations(position: list[float], rotors: bool) -> None:
    """M(q) and g(q) of the textbook's double pendulum, angles from hanging."""
    model = rigs.double_pendulum_spec(rotors).compile()
    inertia, gravity = at(model, position)
    q1, q2 = position
    coupling = L1 * M2 * R2 * np.cos(q2)
    rotor = ROTOR if rotors else 0.0
    expected = [[I1 + I2 + L1**2 * M2 + 2 * coupling + rotor, I2 + coupling],
                [I2 + coupling, I2 + rotor]]  # fmt: skip
    np.testing.assert_allclose(inertia, expected, rtol=1e-9)
    second = 9.81 * M2 * R2 * np.sin(q1 + q2)
    first = 9.81 * (M1 * R1 + M2 * L1) * np.sin(q1) + second
    np.testing.assert_allclose(gravity, [first, second], atol=1e-9)
    assert not model.dof_damping.any()
    assert not model.dof_frictionloss.any()


def test_motors_take_torques() -> None:
    model = rigs.double_pendulum_spec().compile()
    data = mujoco.MjData(model)
    data.ctrl = [0.5, 40.0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, [0.5, 10.0])  # published limit


@pytest.mark.parametrize("kp", [100, 400])
def test_servo_law(kp: int) -> None:
    """torque = kt/R·(duty·V − kt·ω), duty = kp·error·(4096/2π)/(256·885), with other constants."""
    motor = rigs.MotorConstants(kt=0.35, resistance=3.0, supply=6.0)
    model = rigs.servo_bench_spec(kp, motor).compile()
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.ctrl = [0.1], [0.8], [0.3]
    mujoco.mj_forward(model, data)
    duty = kp * 0.2 * (4096 / (2 * np.pi)) / (256 * 885)
    assert data.qfrc_actuator[0] == pytest.approx(0.35 / 3.0 * (duty * 6.0 - 0.35 * 0.8))
    data.ctrl, data.qvel = [50.0], [0.0]
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(0.35 / 3.0 * 6.0)  # duty 1


def test_bench_mass_and_arm() -> None:
    (inertia,), (gravity,) = at(rigs.servo_bench_spec(100).compile(), [np.pi / 2])
    assert inertia[0] == pytest.approx(0.49 * 0.1**2, rel=1e-3)
    assert gravity == pytest.approx(0.49 * 9.81 * 0.1, rel=1e-6)
    (inertia,), (gravity,) = at(rigs.servo_bench_spec(100, arm_mass=0.06).compile(), [np.pi / 2])
    assert inertia[0] == pytest.approx(0.49 * 0.1**2 + 0.06 * 0.1**2 / 3)
    assert gravity == pytest.approx((0.49 * 0.1 + 0.06 * 0.05) * 9.81, rel=1e-6)


def half_second_rmse(model: mujoco.MjModel, r: Recording, joints: list[str]) -> np.ndarray:
    """Open loop from the measured state, restarted every 0.5 s [rad]."""
    q, v, u = (np.stack([r.columns[f"{k}/{j}"] for j in joints], axis=1)
               for k in ("qpos", "qvel", "ctrl"))  # fmt: skip
    data, errors, start = mujoco.MjData(model), [], 0
    for k in range(len(r) - 1):
        if k == 0 or r.t[k] - r.t[start] >= 0.5:
            start, data.time, data.qpos, data.qvel = k, r.t[k], q[k], v[k]
        data.ctrl = u[k]
        while data.time < r.t[k + 1] - 0.5 * model.opt.timestep:
            mujoco.mj_step(model, data)
        errors.append(data.qpos - q[k + 1])
    rmse: np.ndarray = np.sqrt(np.mean(np.square(errors), axis=0))
    return rmse


def test_double_pendulum_replays_as_published(shared: Path) -> None:
    """Over the published runs: .252/.440 rad without friction, .093/.164 with it."""
    folder = shared / "recordings" / "dfki_double_pendulum"
    runs = [base.read(path) for path in sorted(folder.glob("c1_*"))]
    spec = rigs.double_pendulum_spec()
    measured = {}
    for friction in (False, True):
        for name, coulomb in (("shoulder", 0.16), ("elbow", 0.12)):
            spec.joint(name).frictionloss = coulomb if friction else 0.0
            spec.joint(name).damping[0] = 0.001 if friction else 0.0
        each = [half_second_rmse(spec.compile(), r, ["shoulder", "elbow"]) for r in runs]
        measured[friction] = np.sqrt(np.mean(np.square(each), axis=0))
    np.testing.assert_allclose(measured[False], [0.252, 0.440], rtol=0.1)
    np.testing.assert_allclose(measured[True], [0.093, 0.164], rtol=0.1)


def test_bench_replays_as_published(shared: Path) -> None:
    """With fit m1's friction and rotor the open-loop error is that of the fit, .061 to .088 rad."""
    errors = []
    for path in sorted((shared / "recordings" / "bam_xl330").glob("*.json")):
        r = base.read(path)
        command = r.columns["ctrl/hinge"]
        if np.isnan(command).any():  # the torque is off for a while
            continue
        spec = rigs.spec_for(r.meta)
        hinge = spec.joint("hinge")
        hinge.armature, hinge.frictionloss = 0.0018141672784458866, 0.01283272036582759
        hinge.damping[0] = 0.003661672282824312
        model = spec.compile()
        data = mujoco.MjData(model)
        data.time, data.qpos, data.qvel = r.t[0], r.columns["qpos/hinge"][0], 0.0
        for k in range(len(r) - 1):
            data.ctrl = command[k]
            while data.time < r.t[k + 1]:
                mujoco.mj_step(model, data)
            errors.append(abs(data.qpos[0] - r.columns["qpos/hinge"][k + 1]))
    assert 0.05 < np.mean(errors) < 0.09


def test_only_known_rigs() -> None:
    with pytest.raises(DataError, match="does not tell the robot"):
        rigs.spec_for({"format": "npz"})
