"""The same machine in other units of mass, length and time: the same findings, in these units."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.pipeline import diagnose
from wt.types import Recording

DRY = 0.3  # N·m where all units are 1
RATE, SAMPLES = 100.0, 800


def machine(mass: float, length: float, time: float, dry: float) -> str:
    """A swinging link with a servo."""
    torque, inertia = mass * length**2 / time**2, mass * length**2
    down = -9.81 * length / time**2
    return f"""<mujoco>
<option timestep="{1e-3 * time}" gravity="0 0 {down}" integrator="implicitfast"/>
<worldbody><body name="link">
<joint name="j" axis="0 1 0" damping="{0.1 * torque * time}" frictionloss="{dry * torque}"/>
<inertial pos="0 0 {-0.3 * length}" mass="{2.0 * mass}"
 diaginertia="{0.02 * inertia} {0.02 * inertia} {0.002 * inertia}"/>
</body></worldbody>
<actuator><position name="a" joint="j" kp="{60.0 * torque}" kv="{4.0 * torque * time}"/></actuator>
</mujoco>"""


def recorded(xml: str, time: float, seed: int) -> Recording:
    """Slow and fast sines, with an encoder's noise: the same angles whatever the units."""
    model, rng = mujoco.MjModel.from_xml_string(xml), np.random.default_rng(seed)
    data, k = mujoco.MjData(model), np.arange(SAMPLES)
    sines = zip((0.4, 0.3, 0.1), (0.3, 0.7, 1.9), rng.uniform(0.0, 6.28, 3), strict=True)
    command = sum(a * np.sin(2.0 * np.pi * f * k / RATE + p) for a, f, p in sines)
    command *= np.clip(k / 100.0, 0.0, 1.0)
    q = np.empty(SAMPLES)
    for i, data.ctrl[0] in enumerate(command):
        q[i] = data.qpos[0]
        mujoco.mj_step(model, data, 10)
    q += 1e-4 * rng.standard_normal(SAMPLES)
    return Recording(k / RATE * time, {"qpos/j": q, "ctrl/a": command}, {})


@pytest.mark.long
@pytest.mark.parametrize(
    ("mass", "length", "time"),
    [
        # of time less: a log whose seconds are milliseconds is told by how long and fast it is
        (1e-3, 1e3, 0.3),
        (1.0, 1.0, 1.0),
        (1e3, 1.0, 1.0),
        (1e-3, 1.0, 1.0),
        (1.0, 1e3, 1.0),
        (1.0, 1e-3, 1.0),
        (1.0, 1.0, 10.0),
    ],
)
def test_findings_are_the_same_in_other_units(
    tmp_path: Path, mass: float, length: float, time: float
) -> None:
    path = tmp_path / "machine.xml"
    path.write_text(machine(mass, length, time, 0.0))
    fit, hold = (recorded(machine(mass, length, time, DRY), time, seed) for seed in (1, 2))
    found = diagnose(path, [fit], [hold])
    (finding,) = found.findings
    assert (finding.effect, found.verdict) == ("joint.friction_coulomb", "explained")
    torque, coulomb = mass * length**2 / time**2, finding.parameters["coulomb"]
    assert coulomb.value == pytest.approx(DRY * torque, rel=0.02)
    # neither an interval of no width nor one of any width
    low, high = np.array(coulomb.ci95) / (DRY * torque)
    assert 0.9 < low < 0.99
    assert 1.01 < high < 1.1
