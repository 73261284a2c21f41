"""Diagnoses of a two-joint arm, made without the analysis: real MuJoCo replays, known findings."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from pathlib import Path

import mujoco
import numpy as np

from wt.diagnose.evidence import Interval, Role, Trace
from wt.diagnose.result import (
    Confusable,
    Decision,
    Diagnosis,
    Error,
    Estimate,
    Finding,
    Located,
    Proof,
    Used,
)
from wt.types import Location

COULOMB = 0.8  # N·m, hidden in joint j2
ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.0005" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="base" pos="0 0 .1">
      <geom type="cylinder" size=".09 .1"/>
      <body name="upper" pos="0 0 .12">
        <joint name="j1" axis="0 1 0" damping=".5"/>
        <geom type="capsule" fromto="0 0 0 0 0 .4" size=".05" mass="2"/>
        <body name="fore" pos="0 0 .4">
          <joint name="j2" axis="0 1 0" damping=".5"/>
          <geom type="capsule" fromto="0 0 0 .32 0 0" size=".04" mass="1"/>
          <geom name="hand" type="box" pos=".37 0 0" size=".05 .06 .03" mass=".3"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a1" joint="j1" kp="120" kv="6"/>
    <position name="a2" joint="j2" kp="60" kv="3"/>
  </actuator>
</mujoco>
"""
PATCHED = ARM.replace(
    '<joint name="j2" axis="0 1 0" damping=".5"/>',
    f'<joint name="j2" axis="0 1 0" damping=".5" frictionloss="{COULOMB}"/>',
)
RATE = 100.0
J2 = Location("joint", "j2")
A2 = Location("actuator", "a2")
WHEN = (Interval("fit.parquet", 2.1, 2.6), Interval("fit.parquet", 5.4, 6.0))


def commands(seconds: float, phase: float) -> np.ndarray:
    """Two sines a joint, (T, 2) [rad]."""
    t = np.arange(round(seconds * RATE)) / RATE
    return np.stack(
        [
            0.5 * np.sin(1.3 * t + phase) + 0.2 * np.sin(3.1 * t),
            0.7 * np.sin(0.9 * t + phase) + 0.3 * np.sin(2.3 * t + 1.0),
        ],
        axis=1,
    )


def simulate(xml: str, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities under zero-order-hold commands, (T, 2) each."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    steps = round(1 / (RATE * model.opt.timestep))
    q, v = np.empty_like(u), np.empty_like(u)
    for k, command in enumerate(u):
        q[k], v[k] = data.qpos, data.qvel
        data.ctrl[:] = command
        mujoco.mj_step(model, data, steps)
    return q, v


@functools.cache
def trace(name: str, role: Role, seconds: float, phase: float) -> Trace:
    """A recording of the arm with friction, and its replays without and with it.

    It takes most of a second, and many tests want the same: its arrays are read only.
    """
    u = commands(seconds, phase)
    rng = np.random.default_rng(int(10 * phase))
    truth, v = simulate(PATCHED, u)
    before, _ = simulate(ARM, u)
    after, _ = simulate(PATCHED.replace(f'"{COULOMB}"', f'"{COULOMB * 1.02}"'), u)
    recorded = truth + rng.normal(0.0, 2e-4, truth.shape)
    recorded[40:43, 0] = np.nan
    missing = np.zeros_like(v)
    missing[:, 1] = -COULOMB * np.tanh(v[:, 1] / 0.02)
    noise = rng.normal(0.0, 0.06, v.shape)
    made = Trace(
        name=name,
        role=role,
        t=np.arange(len(u)) / RATE,
        recorded=recorded,
        before=before,
        after=after,
        velocity=v,
        force_before=missing + noise,
        force_after=noise,
        command={"a1": u[:, 0], "a2": u[:, 1]},
    )
    for array in (*vars(made).values(), *made.command.values()):
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return made


def diagnosis(model_path: str = "arm.xml") -> Diagnosis:
    """Friction in joint j2, found."""
    held, fitted = (
        trace("held.parquet", "holdout", 12.0, 0.7),
        trace("fit.parquet", "fit", 16.0, 0.0),
    )
    errors = [
        np.sqrt(np.nanmean((held.recorded - q) ** 2, axis=0)) for q in (held.before, held.after)
    ]
    joints = {
        name: Error(
            float(b), float(a), 2e-4, float(a / b), (0.8 * float(a / b), 1.2 * float(a / b))
        )
        for name, b, a in zip(("j1", "j2"), *errors, strict=True)
    }
    whole = [float(np.sqrt(np.mean(e**2))) for e in errors]
    share = whole[1] / whole[0]
    found = Finding(
        effect="joint.friction_coulomb",
        at=J2,
        parameters={"coulomb": Estimate(0.8123, "N·m", (0.795, 0.829))},
        statement="Joint j2 loses 0.81 N·m to dry friction that the model leaves out.",
        holdout_gain=0.97,
        p_value=1e-9,
        confusable_with=(
            Confusable("joint.friction_stribeck", J2, "slow reversals of j2 below 0.05 rad/s"),
        ),
        reference="C.-A. Coulomb, Théorie des machines simples, 1785",
    )
    return Diagnosis(
        model_path=model_path,
        model_sha256=hashlib.sha256(ARM.encode()).hexdigest(),
        joints=("j1", "j2"),
        recordings=(
            Used("fit.parquet", "fit", 16.0, RATE),
            Used("held.parquet", "holdout", 12.0, RATE),
        ),
        verdict="explained",
        locations=(
            Located(J2, 0.93, WHEN, "at speeds below 0.1 rad/s"),
            Located(A2, 0.07),
        ),
        findings=(found,),
        proof=Proof(
            holdout=Error(*whole, 2e-4, share, (0.8 * share, 1.2 * share)),
            joints=joints,
            horizons={"rad": {0.1: (9e-4, 2.1e-4), 0.5: (3e-3, 2.6e-4), 2.0: (6e-3, 3e-4)}},
            split="recordings given with --holdout",
        ),
        given_xml=ARM,
        patched_xml=PATCHED,
        decisions=(
            Decision("actuator.gain", A2, "screened", False, 12.0, 162.4, "others show far more"),
            Decision("joint.friction_viscous", J2, "replayed", False, 301.5, 812.0, "beaten"),
            Decision("joint.friction_coulomb", J2, "joined", True, 812.0, 12.0, "the best"),
            Decision("joint.friction_coulomb", J2, "holdout", True, 1e-9, 0.01, "proven"),
        ),
        traces=(held, fitted),
        suggestions=("slow reversals of j2 below 0.05 rad/s",),
        notes=("The model's time step of 2 ms was refined to 0.5 ms for the comparison.",),
        seconds=21.5,
    )


def nothing(model_path: str = "arm.xml") -> Diagnosis:
    """A model that fits: replays of it, and no findings."""
    full = diagnosis(model_path)
    fine = Error(2.1e-4, 2.1e-4, 2e-4, 1.0, (1.0, 1.0))
    proof = Proof(fine, {"j1": fine, "j2": fine}, {})
    traces = tuple(dataclasses.replace(t, before=t.after) for t in full.traces)
    return dataclasses.replace(
        full, verdict="no_mismatch", locations=(), findings=(), proof=proof, patched_xml=ARM,
        decisions=(), suggestions=(), notes=(), traces=traces,
    )  # fmt: skip


def unexplained(model_path: str = "arm.xml") -> Diagnosis:
    """A mismatch at joint j2 that no effect of the library explains, with a learned remainder."""
    full = diagnosis(model_path)
    (found,) = full.findings
    unknown = dataclasses.replace(
        found,
        effect="unknown",
        parameters={},
        statement="An unknown force acts at joint j2; it depends on qvel/j2 & qpos/j1.",
        confusable_with=(),
        depends_on=("qvel/j2", "qpos/j1"),
        formula="-0.8*tanh(qvel/j2 / 0.02) < 1",
        formula_gain=0.42,
        reference="",
    )
    return dataclasses.replace(
        full, verdict="unexplained", findings=(unknown,), residual_onnx=b"onnx bytes"
    )


def write_model(folder: Path) -> Path:
    """The arm's MJCF as a file."""
    path = folder / "arm.xml"
    path.write_text(ARM)
    return path
