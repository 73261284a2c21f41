"""Limbs that hang apart from each other are replayed apart, and say what the whole machine does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wt.diagnose.unknown.force import UnknownForce
from wt.diagnose.unknown.law import Law
from wt.physics import workers
from wt.physics.effect import effects
from wt.physics.limbs import limbs
from wt.physics.motion import Motion, Segment
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.physics.spread import over
from wt.physics.workers import Workers
from wt.types import Location

DT, SAMPLES = 0.01, 150


def hand(between: str = "", apart: float = 0.3, extra: str = "") -> str:
    """Two fingers of two joints on a palm that nothing moves; the second has a geared drive."""

    def finger(name: str, y: float) -> str:
        return f"""<body name="{name}_near" pos="0 {y} 0"><joint name="{name}1" damping=".02"/>
<geom type="capsule" fromto="0 0 0 .1 0 -.1" size=".02" mass=".3"/>
<body name="{name}_far" pos=".1 0 -.1"><joint name="{name}2" axis="1 0 0" damping=".02"/>
<geom type="capsule" fromto="0 0 0 0 0 -.15" size=".02" mass=".2"/></body></body>"""

    drives = "".join(
        f'<position name="{joint}_drive" joint="{joint}" kp="4" kv=".1" {given}/>'
        for joint, given in (("b2", 'gear="1.2"'), ("a1", ""), ("b1", ""), ("a2", ""))
    )
    return f"""<mujoco><option timestep=".002" integrator="implicitfast"/>{extra}
<worldbody><body name="palm" pos="0 0 1"><geom size=".03"/>{finger("a", 0.0)}{finger("b", apart)}
</body></worldbody><actuator>{drives}</actuator>{between}
<keyframe><key name="home" qpos="0 0 0 0" ctrl="0 0 0 0"/></keyframe></mujoco>"""


def scene(folder: Path, xml: str) -> Scene:
    path = folder / "robot.xml"
    path.write_text(xml)
    return Scene(path)


def recorded(scene: Scene) -> Stretch:
    """What the machine does on sines, as one stretch."""
    m = scene.model
    d, t = mujoco.MjData(m), DT * np.arange(SAMPLES)
    command = 0.5 * np.sin(np.outer(t, 3.0 + np.arange(m.nu)))
    rows = []
    for u in command:
        rows.append((d.qpos.copy(), d.qvel.copy()))
        d.ctrl[:] = u
        mujoco.mj_step(m, d, round(DT / m.opt.timestep))
    q, v = (np.array(x) for x in zip(*rows, strict=True))
    segment = Segment(slice(0, SAMPLES), 0, DT)
    motion = Motion(scene, (segment,), t, q, v, np.gradient(v, DT, axis=0), command)
    return Stretch(0, t, command, q[0], v[0], segment=segment, motion=motion)


def planted(effect: str, kind: str, name: str, *theta: float) -> Planted:
    return Planted(effects()[effect], Location(kind, name), np.array(theta))  # type: ignore[arg-type]


TENDON = """<tendon><fixed><joint joint="a1" coef="1"/><joint joint="b1" coef="1"/></fixed>
</tendon>"""
FRICTION = planted("joint.friction_viscous", "joint", "b2", 0.1)
HYPOTHESES = [
    (),
    (FRICTION,),
    (planted("joint.friction_stribeck", "joint", "a1", 0.1, 0.2, 0.1), FRICTION),
    (planted("joint.backlash", "joint", "b1", 0.05, 0.0),),
    (planted("pair.spring", "pair", "b1+b2", 0.3, 1.0, 0.0),),
    (planted("actuator.delay", "actuator", "all", 0.008),),
    (planted("actuator.gain", "actuator", "b2_drive", 0.8),),
    (planted("body.payload_fixed", "body", "a_far", 0.2, 0.0, 0.0, -0.1),),
    (planted("world.gravity", "world", "world", 0.5, 0.0, -9.7),),
    (planted("sensor.offset", "joint", "a2", 0.05),),
]


def test_apart_as_together(tmp_path: Path) -> None:
    whole = scene(tmp_path, hand())
    stretch = recorded(whole)
    apart, together = (Replayer(whole, [stretch], 1e-3) for _ in range(2))
    together.__dict__["_limbs"] = None
    ours, theirs = apart.run(HYPOTHESES), together.run(HYPOTHESES)
    assert np.ptp(theirs.q, axis=0).max() > 0.01
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-7)
    np.testing.assert_allclose(ours.v, theirs.v, atol=1e-5)


def test_each_limb_is_replayed_as_often_as_hypotheses_differ_in_it(tmp_path: Path) -> None:
    whole = scene(tmp_path, hand())
    found = limbs(whole, recorded(whole).motion)  # type: ignore[arg-type]
    assert found is not None
    first, second = found.each
    assert first.scene.joints == ("a1", "a2") and second.scene.joints == ("b1", "b2")
    assert second.actuators.tolist() == [0, 2] and second.dofs.tolist() == [2, 3]
    assert found.on(HYPOTHESES[2]) == [HYPOTHESES[2][:1], (FRICTION,)]
    assert found.on(HYPOTHESES[5]) == [HYPOTHESES[5], HYPOTHESES[5]]
    run: list[tuple[str, ...]] = []
    replayer = Replayer(whole, [recorded(whole)], 1e-3)
    for limb, own in replayer._own:
        compiled = own.compile
        own.compile = lambda h, c=compiled, n=limb.scene.joints: (run.append(n), c(h))[1]  # type: ignore[method-assign]
    replayer.run([(planted("joint.friction_viscous", "joint", "b2", x),) for x in (0.1, 0.2, 0.3)])
    assert run.count(("a1", "a2")) == 1 and run.count(("b1", "b2")) == 3


def test_what_acts_on_other_limbs_need_not_adapt(tmp_path: Path) -> None:
    whole = scene(tmp_path, hand())
    found = limbs(whole, recorded(whole).motion)  # type: ignore[arg-type]
    assert found is not None
    on_a, on_b, both = HYPOTHESES[2][0], FRICTION, HYPOTHESES[5][0]
    load, gain = HYPOTHESES[7][0], HYPOTHESES[6][0]
    assert found.together((on_a, on_b, load, gain), [0]) == [0, 2]
    assert found.together((on_a, on_b, load, gain), [1]) == [1, 3]
    assert found.together((on_a, on_b, load, gain), [2, 3]) == [0, 1, 2, 3]
    assert found.together((on_a, both, on_b), [0]) == [0, 1]
    spring = planted("pair.spring", "pair", "a1+b1", 0.3, 1.0, 0.0)
    assert found.together((on_a, on_b, spring), [0]) == [0, 1, 2]


def test_laws_that_a_replay_brings_about_share_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = scene(tmp_path, hand(apart=0.03))  # in one piece
    stretch, load, late = recorded(whole), HYPOTHESES[7], HYPOTHESES[5]
    dry = [(planted("joint.friction_stribeck", "joint", "a1", x, 0.2, 0.1),) for x in (0.1, 0.2)]
    both = [*dry, late, (*dry[0], *late), (*load, *dry[0]), (*load, *late), HYPOTHESES[6]]
    alone = [Replayer(whole, [stretch], 1e-3).run([h]).q[0] for h in both]
    count, compiled = list[int](), Replayer.compile

    def counted(self: Replayer, hypothesis: Sequence[Planted]) -> mujoco.MjModel:
        count.append(len(hypothesis))
        return compiled(self, hypothesis)

    monkeypatch.setattr(Replayer, "compile", counted)
    np.testing.assert_array_equal(Replayer(whole, [stretch], 1e-3).run(both).q, alone)
    assert len(count) == 3  # as given, with the load, with the gain


def test_processes_are_asked_for_the_limb_alone_that_has_a_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "_WORTH_S", 0.0)
    monkeypatch.setattr(workers, "_WORTH_STEPS", 1)
    asked, spread = list[tuple[tuple[str, ...], int]](), Workers._spread

    def counted(
        self: Workers, replays: Replayer, hypotheses: Sequence[Sequence[Planted]]
    ) -> np.ndarray:
        asked.append((replays.scene.joints, len(hypotheses)))
        return spread(self, replays, hypotheses)

    monkeypatch.setattr(Workers, "_spread", counted)
    whole = scene(tmp_path, hand())
    stretch, dry = recorded(whole), HYPOTHESES[2][:1]
    here = Replayer(whole, [stretch], 1e-3).run([dry, (*dry, FRICTION), (FRICTION,)])
    with over(2):
        said = Replayer(whole, [stretch], 1e-3).run([dry, (*dry, FRICTION), (FRICTION,)])
    assert asked == [(("a1", "a2"), 1)]
    np.testing.assert_array_equal(said.q, here.q)
    np.testing.assert_array_equal(said.v, here.v)


def test_what_couples_limbs_is_replayed_together(tmp_path: Path) -> None:
    whole = scene(tmp_path, hand())
    found = limbs(whole, recorded(whole).motion)  # type: ignore[arg-type]
    assert found is not None
    assert found.on([planted("pair.spring", "pair", "a1+b1", 0.3, 1.0, 0.0)]) is None
    law = Law(("qpos/a1",), np.full(1, -1.0), np.full(1, 1.0), (), np.zeros(0))
    assert found.on([Planted(UnknownForce(law, ""), Location("joint", "b1"), np.ones(1))]) is None


@pytest.mark.parametrize(
    "xml",
    [
        hand(apart=0.03),  # they touch
        hand('<equality><joint joint1="a1" joint2="b1"/></equality>'),
        hand(TENDON),
        hand().replace('<body name="palm" pos="0 0 1">', '<body name="palm"><joint name="base"/>'),
    ],
    ids=["touching", "equality", "tendon", "one tree"],
)  # fmt: skip
def test_limbs_that_depend_on_each_other_are_none(xml: str, tmp_path: Path) -> None:
    whole = scene(tmp_path, xml.replace('qpos="0 0 0 0"', "") if "base" in xml else xml)
    assert limbs(whole, recorded(whole).motion) is None  # type: ignore[arg-type]
