"""Several laws of a servo's joint are found at once, where others stand in for them one by one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection import search as search_module
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.memory import Memory
from wt.diagnose.selection.search import _exchanged, _State, search
from wt.diagnose.selection.several import several
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

MJCF = """\
<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body name="link">
<joint name="hinge" axis="0 1 0" damping="{damping}" armature="{rotor}" frictionloss="{dry}"/>
<geom type="capsule" fromto="0 0 0 .3 0 -.2" size=".03" mass="1.2"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="{kp}" kv="{kv}"/></actuator></mujoco>
"""
RATE, SECONDS, NOISE = 100, 8.0, 1e-4  # Hz, s, rad
KP, KV, DAMPING, ROTOR = 60.0, 3.0, 0.5, 0.01


@dataclass
class Servo:
    """What a link's servo and joint are like; by default as the model says."""

    kp: float = KP
    kv: float = KV
    damping: float = DAMPING
    rotor: float = ROTOR
    dry: float = 0.0

    @property
    def mjcf(self) -> str:
        return MJCF.format(**vars(self))


def record(servo: Servo, seed: int) -> Recording:
    """A multisine with steps."""
    model = mujoco.MjModel.from_xml_string(servo.mjcf)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    t = np.arange(int(SECONDS * RATE)) / RATE
    rate, phase = rng.uniform(0.15, 1.2, 4), rng.uniform(0.0, 6.28, 4)
    u = 0.2 * np.sin(2.0 * np.pi * t[:, None] * rate + phase).sum(axis=1)
    u = (u + 0.4 * (np.floor(t / 1.7) % 2)) * np.minimum(t / 2.0, 1.0)
    q = np.empty(len(t))
    for k in range(len(t)):
        q[k], data.ctrl[:] = data.qpos[0], u[k]
        mujoco.mj_step(model, data, 20)
    return Recording(t, {"qpos/hinge": q + NOISE * rng.standard_normal(len(t)), "ctrl/servo": u})


def replays(folder: Path, *servos: Servo) -> tuple[Screen, Objective]:
    """The model beside a recording of each of some servos."""
    path = folder / "link.xml"
    path.write_text(Servo().mjcf)
    parts = [Part(record(servo, 5 + i), i) for i, servo in enumerate(servos)]
    fitted = smooth(Scene(path), parts)
    return Screen(fitted, 0), Objective(fitted, stretches_of(fitted, True), 1e-3, True)


def planted(name: str, kind: str, *theta: float) -> Planted:
    at = Location(kind, {"joint": "hinge", "actuator": "servo"}[kind])
    return Planted(effects()[f"{kind}.{name}"], at, np.array(theta))


def found(objective: Objective, now: Assessed) -> dict[str, float]:
    return {p.effect.id: float(p.theta[0]) for p, _ in several(objective, now, 0)}


CASES = [
    (
        Servo(kp=0.8 * KP, kv=1.3 * KV),
        {"actuator.gain": 0.8, "joint.friction_viscous": (1.3 - 0.8) * KV},
    ),
    (
        Servo(kp=1.2 * KP, kv=0.6 * KV, dry=0.3, rotor=0.05),
        {
            "actuator.gain": 1.2,
            "actuator.damping": 0.5,
            "joint.friction_coulomb": 0.3,
            "joint.armature": 0.04,
        },
    ),
    (
        Servo(kp=1.3 * KP, kv=1.3 * KV, damping=0.1),
        {"actuator.gain": 1.3, "joint.friction_viscous": -0.4},
    ),
]


@pytest.mark.parametrize(("servo", "right"), CASES)
def test_they_are_found_where_something_stands_in_for_them(
    tmp_path: Path, servo: Servo, right: dict[str, float]
) -> None:
    _, objective = replays(tmp_path, servo)
    objective.reference(())
    stand_in = (planted("friction_directional", "joint", 0.1, 0.2, 0.1, 0.1),)
    (now,) = refine(objective, [stand_in], [[0]])
    now = objective.reference(now.hypothesis)
    assert found(objective, now) == pytest.approx(right, rel=0.25)  # replays refine them


@pytest.mark.parametrize("law", [None, planted("friction_coulomb", "joint", 0.3)])
def test_none_are_asked_for_beside_what_says_all(tmp_path: Path, law: Planted | None) -> None:
    _, objective = replays(tmp_path, Servo(dry=0.3 if law else 0.0))
    now = objective.reference((law,) if law else ())
    assert several(objective, now, 0) == []


@pytest.mark.parametrize("other", [0.3, 0.0])
def test_what_another_motion_does_not_have_is_none_of_them(tmp_path: Path, other: float) -> None:
    """Half of it would leave half of the error of both together."""
    _, objective = replays(tmp_path, Servo(dry=0.3), Servo(dry=other))
    laws = found(objective, objective.reference(()))
    assert ("joint.friction_coulomb" in laws) == (other > 0.0)


def test_what_an_encoder_says_is_none_of_them(tmp_path: Path) -> None:
    path, said = tmp_path / "link.xml", record(Servo(dry=0.3), 5)
    path.write_text(Servo().mjcf)
    columns = {**said.columns, "qpos/hinge": 1.08 * said.columns["qpos/hinge"]}
    fitted = smooth(Scene(path), [Part(Recording(said.t, columns), 0)])
    objective = Objective(fitted, stretches_of(fitted, True), 1e-3, True)
    laws = found(objective, objective.reference(()))
    assert laws and not any(name.startswith("sensor.") for name in laws)


def test_what_was_refused_is_none_of_them(tmp_path: Path) -> None:
    _, objective = replays(tmp_path, CASES[0][0])
    now, refused = objective.reference(()), planted("gain", "actuator", 1.0).key
    laws = several(objective, now, 0, {refused})
    assert refused not in {p.key for p, _ in laws}


def test_a_search_ends_with_them(tmp_path: Path) -> None:
    servo, right = CASES[0]
    screen, objective = replays(tmp_path, servo)
    end = search(screen, objective, DecisionLog())
    assert {a.planted.effect.id: float(a.planted.theta[0]) for a in end} == pytest.approx(
        right, rel=0.05
    )


@pytest.mark.parametrize("better", [False, True])
def test_they_take_no_place_without_being_clearly_ahead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, better: bool
) -> None:
    """Two that say as much as one are not; the state is as it was, and the replays are."""
    _, objective = replays(tmp_path, Servo(dry=0.3))
    dry, wet = planted("friction_coulomb", "joint", 0.3), planted("friction_viscous", "joint", 0.1)
    one, two = (wet, [dry, wet]) if better else (dry, [wet, planted("bias", "actuator", 0.01)])
    (now,) = refine(objective, [objective.reference((one,)).hypothesis], [[0]])
    now = objective.reference(now.hypothesis)
    state = _State([Accepted(now.hypothesis[0], (), ())], now)
    monkeypatch.setattr(search_module, "erring_joints", lambda *_: [0])
    monkeypatch.setattr(search_module, "several", lambda *_: [(p, ()) for p in two])
    log, memory = DecisionLog(), Memory(objective)
    after = _exchanged(objective, state, log, (), memory, False)
    assert [a.planted.effect.id for a in after.accepted] == ["joint.friction_coulomb"]
    assert [(d.stage, d.kept) for d in log] == (
        [("reconsidered", False), ("joined", True)] if better else [("reconsidered", True)]
    )
    assert (
        objective.left(after.now) == objective.left(objective.reference(after.now.hypothesis))
    ).all()
    # asked once of a joint as it is
    assert better or _exchanged(objective, after, log, (), memory, False) is after
