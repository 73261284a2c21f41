"""A servo's joint that rests against a stop, or against another body, has no other zero."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.check.balance import Balance, Edit
from wt.check.run import check
from wt.check.signals import Signals
from wt.physics.scene import Scene
from wt.types import Recording

FINGERS = """<mujoco><compiler angle="radian"/><option timestep=".002"/><worldbody>
<body name="a"><joint name="left" axis="0 1 0" damping=".02" armature=".001"{stop}/>
<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".02"/></body>
<body name="b" pos="0 .2 0"><joint name="right" axis="0 1 0" damping=".02" armature=".001"/>
<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".02"/></body>{thing}</worldbody>
<actuator><position name="l" joint="left" kp="1" kv=".03"/>
<position name="r" joint="right" kp="1" kv=".03"/></actuator></mujoco>"""
BY = {
    "stop": {"stop": ' range="-2 .1" limited="true"', "thing": ""},
    "thing": {"stop": "", "thing": '<geom type="box" pos=".1 0 -.06" size=".04 .05 .02"/>'},
}
RATE = 100


def recorded(xml: str) -> Recording:
    """One finger is sent through something, the other moves freely."""
    m = mujoco.MjModel.from_xml_string(xml)
    d, rng = mujoco.MjData(m), np.random.default_rng(0)
    t = np.arange(800) / RATE
    u = np.stack([0.9 + 0.2 * np.sin(3.0 * t), 0.4 * np.sin(5.0 * t)], axis=1)
    q = np.empty_like(u)
    for k in range(len(t)):
        q[k], d.ctrl[:] = d.qpos, u[k]
        mujoco.mj_step(m, d, round(1.0 / (RATE * m.opt.timestep)))
    q += rng.normal(0.0, 1e-4, q.shape)
    columns = {f"ctrl/{n}": u[:, i] for i, n in enumerate("lr")}
    return Recording(t, columns | {f"qpos/{n}": q[:, i] for i, n in enumerate(("left", "right"))})


def scene_of(xml: str, folder: Path) -> Scene:
    path = folder / "fingers.xml"
    path.write_text(xml)
    return Scene(path)


@pytest.mark.parametrize("what", BY)
def test_what_holds_a_joint_is_no_encoders_zero(what: str, tmp_path: Path) -> None:
    xml = FINGERS.format(**BY[what])
    found = check(scene_of(xml, tmp_path), recorded(xml)).findings
    assert not [f.kind for f in found if f.sure]


def test_an_encoders_zero_is_found_where_nothing_holds(tmp_path: Path) -> None:
    recording = recorded(FINGERS.format(stop="", thing=""))
    columns = {**recording.columns, "qpos/left": recording.columns["qpos/left"] - 0.6}
    recording = replace(recording, columns=columns)
    found = check(scene_of(FINGERS.format(**BY["thing"]), tmp_path), recording).findings
    assert [(f.kind, f.columns) for f in found if f.sure] == [("encoder_zero", ("qpos/left",))]


def test_a_drive_is_not_asked_what_another_limb_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hand has hundreds of pairs of joints, of which each drive feels a few."""
    xml = FINGERS.format(stop="", thing="")
    scene, recording = scene_of(xml, tmp_path), recorded(xml)
    signals = Signals.of(scene, recording)
    assert signals is not None
    balance = Balance(scene, signals)
    balance.unexplained()
    asked: list[str] = []
    fit = balance._fit
    monkeypatch.setattr(
        balance, "_fit", lambda row, *a: (asked.append(row.drive.joint), fit(row, *a))[1]
    )
    balance.unexplained([Edit("q", 0, 0, -1.0)])
    assert asked == ["left"]
