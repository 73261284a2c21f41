"""Actuators that are no plain servo or motor: replays and forces are MuJoCo's own."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.check.run import check
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location, Recording

SERVOS = '<position name="m1" joint="j1" kp="60" kv="3"/>'
SECOND = '<position name="m2" joint="j2" kp="30" kv="2"/>'
TENDON = '<tendon><fixed name="t"><joint joint="j1" coef="1"/><joint joint="j2" coef=".5"/></fixed>'


def machine(drives: str, joint: str = "", link: str = "", more: str = "") -> str:
    return (
        '<mujoco><compiler angle="radian" autolimits="true"/>'
        '<option timestep="5e-4" integrator="implicitfast"/><worldbody>'
        f'<body name="a"><joint name="j1" axis="0 1 0" damping=".2" armature=".01" {joint}/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".8"/>'
        f'<body name="b" pos="0 0 -.3" {link}><joint name="j2" axis="0 1 0" damping=".1"'
        ' armature=".01"/><geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02" mass=".5"/>'
        f'<site name="tip" pos="0 0 -.25"/></body></body></worldbody>{more}'
        f"<actuator>{drives}</actuator></mujoco>"
    )


MACHINES = {
    "filter with limits": machine(
        '<general name="m1" joint="j1" dyntype="filterexact" dynprm=".03" gainprm="60"'
        f' biastype="affine" biasprm="0 -60 -3" actrange="-.2 .2"/>{SECOND}'
    ),
    "tendon with clamps": machine(
        '<position name="m1" tendon="t" kp="60" kv="3" ctrlrange="-.5 .5" forcerange="-9 9"/>'
        + SECOND,
        more=TENDON + "</tendon>",
    ),
    "rate": machine(f'<intvelocity name="m1" joint="j1" kp="60" kv="3"/>{SECOND}'),
    "damper": machine(f'{SERVOS}{SECOND}<damper name="d" joint="j1" kv="2" ctrlrange="0 1"/>'),
    "site": machine(
        f'<general name="m3" site="tip" gear="0 0 1 0 0 0" gainprm="5"/>{SERVOS}{SECOND}'
    ),
    "in the parent's frame": machine(
        f'<position name="m1" jointinparent="j1" kp="60" kv="3"/>{SECOND}'
    ),
    "late": machine(
        f'<position name="m1" joint="j1" kp="60" kv="3" delay=".02" nsample="60"/>{SECOND}'
    ),
    "coupled": machine(
        SERVOS, more='<equality><joint joint1="j2" joint2="j1" polycoef="0 .7 0 0 0"/></equality>'
    ),
    "drives carry gravity": machine(
        SERVOS + SECOND, joint='actuatorgravcomp="true"', link='gravcomp="1"'
    ),
    "joint lets little through": machine(SERVOS + SECOND, joint='actuatorfrcrange="-4 4"'),
}


def recorded(xml: str) -> Recording:
    """Four seconds at 100 Hz of the very machine, hardly any noise."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, n, rng = mujoco.MjData(model), 400, np.random.default_rng(0)
    t = 0.01 * np.arange(n)
    u = np.stack(
        [0.4 * np.sin((2.0 + 1.3 * i) * t + i) + 0.1 * np.sin(7.0 * t) for i in range(model.nu)], 1
    )
    q = np.empty((n, model.nq))
    for k in range(n):
        data.ctrl[:], q[k] = u[k], data.qpos
        mujoco.mj_step(model, data, 20)
    q += 1e-5 * rng.standard_normal(q.shape)
    columns = {f"qpos/{model.joint(i).name}": q[:, i] for i in range(model.njnt)}
    columns |= {f"ctrl/{model.actuator(i).name}": u[:, i] for i in range(model.nu)}
    return Recording(t, columns)


@pytest.mark.parametrize("name", MACHINES)
def test_nothing_is_missing(name: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.xml"
    path.write_text(MACHINES[name])
    scene, recording = Scene(path), recorded(MACHINES[name])
    assert not [f for f in check(scene, recording).findings if f.sure]
    smoothed = smooth(scene, prepare(scene, [recording], []).whole)
    pairs = stretches_of(smoothed, False, 4.0)
    q = Replayer(scene, [s for s, _ in pairs], 5e-4).run([()]).q[0]
    error = np.sqrt(np.mean((q - np.concatenate([x for _, x in pairs])) ** 2, axis=0))
    assert (error < 0.005 * np.ptp(smoothed.samples[0].q, axis=0)).all()
    # the force residual, from which every search begins
    inside = slice(20, -20)
    left, demand = smoothed.motion.unexplained[inside], smoothed.motion.demand[inside]
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(demand**2))


def test_all_late_are_those_on_tendons_and_sites_too(tmp_path: Path) -> None:
    """A hand whose fingers a tendon closes is no less late than its arm, in replays and files."""
    site = '<general name="m3" site="tip" gear="0 0 1 0 0 0" gainprm="5"/>'
    tendon = '<position name="m1" tendon="t" kp="60" kv="3"/>'
    motor = '<dcmotor name="m1" joint="j1" motorconst="1" resistance="1"/>'
    for given in (tendon + SECOND, site + SERVOS + SECOND, motor + SECOND):
        given = machine(given, more=TENDON + "</tendon>")
        late = mujoco.MjSpec.from_string(given)
        for drive in late.actuators:
            drive.delay, drive.nsample, drive.interp = 0.02, 60, 1  # linear
        late.compile()
        path = tmp_path / "machine.xml"
        path.write_text(given)
        scene = Scene(path)
        smoothed = smooth(scene, prepare(scene, [recorded(late.to_xml())], []).whole)
        pairs = stretches_of(smoothed, False, 4.0)
        delay = Planted(effects()["actuator.delay"], Location("actuator", "all"), np.array([0.02]))
        q = Replayer(scene, [s for s, _ in pairs], 5e-4).run([(delay,), ()]).q
        measured = np.concatenate([x for _, x in pairs])
        spec = scene.spec()
        delay.effect.patch(spec, delay.at, delay.theta)
        assert {drive.delay for drive in spec.actuators} == {0.02}
        error, before = np.sqrt(np.mean((q - measured) ** 2, axis=(1, 2)))
        assert error < 0.05 * before
