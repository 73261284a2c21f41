"""What all of a machine's drives lack is found at all joints at once."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.likelihood.bic import merit
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.selection.alike import alike
from wt.diagnose.selection.memory import Memory
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

JOINTS, RATE, SECONDS, NOISE = 3, 100, 8.0, 1e-4  # -, Hz, s, rad
KP, ROTOR = 60.0, 0.03  # N·m/rad, kg·m²
WEAK, DRY, LIGHT = 0.7, 0.25, 0.012  # of the gain, N·m, kg·m²


def arm(gains: list[float], dry: list[float], rotors: list[float]) -> str:
    """Links one on another that swing in one plane, each on a servo."""
    links, ends = "", ""
    for i, (friction, rotor) in enumerate(zip(dry, rotors, strict=True)):
        links += (
            f'<body name="link{i}" pos="0 0 {-0.25 if i else 0}"><joint name="j{i}" axis="0 1 0" '
            f'damping=".6" frictionloss="{friction}" armature="{rotor}"/>'
            f'<geom type="capsule" fromto="0 0 0 .02 0 -.25" size=".02" mass="{0.6 - 0.15 * i}"/>'
        )
        ends += "</body>"
    drives = "".join(
        f'<position name="s{i}" joint="j{i}" kp="{KP * gain}" kv="{2 * gain}"/>'
        for i, gain in enumerate(gains)
    )
    return (
        '<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>'
        f"<worldbody>{links}{ends}</worldbody><actuator>{drives}</actuator></mujoco>"
    )


def record(mjcf: str, seed: int) -> Recording:
    """A multisine with steps in every joint."""
    model = mujoco.MjModel.from_xml_string(mjcf)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    t = np.arange(int(SECONDS * RATE)) / RATE
    u = np.empty((len(t), JOINTS))
    for i in range(JOINTS):
        rate, phase = rng.uniform(0.15, 1.6, 4), rng.uniform(0.0, 6.28, 4)
        u[:, i] = 0.2 * np.sin(2.0 * np.pi * t[:, None] * rate + phase).sum(axis=1)
        u[:, i] += 0.4 * (np.floor((t + 0.5 * i) / 1.7) % 2)
    u *= np.minimum(t / 2.0, 1.0)[:, None]
    q = np.empty_like(u)
    for k in range(len(t)):
        q[k], data.ctrl[:] = data.qpos, u[k]
        mujoco.mj_step(model, data, 20)
    q += NOISE * rng.standard_normal(q.shape)
    columns = {f"qpos/j{i}": q[:, i] for i in range(JOINTS)}
    return Recording(t, {**columns, **{f"ctrl/s{i}": u[:, i] for i in range(JOINTS)}})


def replays(folder: Path, *machines: str) -> Objective:
    """The model beside a recording of each of some machines."""
    path = folder / "arm.xml"
    path.write_text(arm([1.0] * JOINTS, [0.0] * JOINTS, [ROTOR] * JOINTS))
    parts = [Part(record(machine, 5 + i), i) for i, machine in enumerate(machines)]
    fitted = smooth(Scene(path), parts)
    return Objective(fitted, stretches_of(fitted, True), 1e-3, True)


def test_the_same_laws_are_found_at_every_joint(tmp_path: Path) -> None:
    objective = replays(tmp_path, arm([WEAK] * JOINTS, [DRY] * JOINTS, [LIGHT] * JOINTS))
    now = objective.reference(())
    found = {
        (p.effect.id, p.at.name): float(p.theta[0]) for p, _ in alike(objective, now, range(JOINTS))
    }
    for i in range(JOINTS):
        assert found[("actuator.gain", f"s{i}")] == pytest.approx(WEAK, rel=0.1)
        assert found[("joint.friction_coulomb", f"j{i}")] == pytest.approx(DRY, rel=0.2)
        assert found[("joint.armature", f"j{i}")] == pytest.approx(LIGHT - ROTOR, rel=0.3)
    after = objective.evaluate([tuple(p for p, _ in alike(objective, now, range(JOINTS)))])[0]
    assert merit(objective, after) > merit(objective, now) + 100.0


@pytest.mark.long
def test_a_joint_without_them_gets_none(tmp_path: Path) -> None:
    mjcf = arm([WEAK, WEAK, 1.0], [DRY, DRY, 0.0], [ROTOR] * JOINTS)
    objective = replays(tmp_path, mjcf)
    laws = alike(objective, objective.reference(()), range(JOINTS))
    found = {(p.effect.id, p.at.name): float(p.theta[0]) for p, _ in laws}
    spare = found.pop(("actuator.gain", "s2"), 1.0)  # what masses may be off by looks like it
    assert spare == pytest.approx(1.0, abs=0.1)
    laws_of_both = "actuator.gain", "joint.friction_coulomb"
    assert {name for name, _ in found} == set(laws_of_both)
    assert {at for _, at in found} == {"s0", "s1", "j0", "j1"}


def test_what_was_refused_is_none_of_them(tmp_path: Path) -> None:
    objective = replays(tmp_path, arm([1.0] * JOINTS, [DRY] * JOINTS, [ROTOR] * JOINTS))
    refused = ("joint.friction_coulomb", "joint", "j1")
    laws = alike(objective, objective.reference(()), range(JOINTS), {refused})
    assert refused not in {p.key for p, _ in laws}
    assert ("joint.friction_coulomb", "joint", "j0") in {p.key for p, _ in laws}


def test_joints_are_asked_together_once_for_what_they_have(tmp_path: Path) -> None:
    objective = replays(tmp_path, arm([1.0] * JOINTS, [DRY] * JOINTS, [ROTOR] * JOINTS))
    memory, now = Memory(objective), objective.reference(())
    assert memory.unasked_together(now, [0, 1])
    assert not memory.unasked_together(now, [1, 0])
    assert memory.unasked_together(now, [0, 1, 2])
    at = Location("joint", "j0")
    law = Planted(effects()["joint.friction_coulomb"], at, np.array([DRY]))
    assert memory.unasked_together(objective.reference((law,)), [0, 1])
