"""Pushes on a torque-driven double pendulum whose model errs: found by themselves, else none."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from tests.conftest import FromShared
from wt.data.importers.dfki_double_pendulum import DfkiDoublePendulum
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.events import Event, _at_once, _Found, _less, _proven, events
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.effects.force_intermittent import ForceIntermittent, seen
from wt.physics.planted import Planted
from wt.physics.pushes import Push, flat
from wt.physics.scene import Scene
from wt.types import Location, Recording

PENDULUM = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody>
<body><joint name="shoulder" axis="0 1 0" damping="{0}" frictionloss="{1}" armature=".002"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".6" contype="0" conaffinity="0"/>
<body pos="0 0 -.3"><joint name="elbow" axis="0 1 0" damping="{0}" frictionloss="{1}"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="{2}" contype="0" conaffinity="0"/>
</body></body></worldbody>
<actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""
MODEL = PENDULUM.format(0.02, 0.0, 0.5)
MACHINE = PENDULUM.format(0.03, 0.08, 0.51)
PUSHES = (("shoulder", 2.4, 0.07, 0.6), ("elbow", 4.1, 0.09, -0.4), ("shoulder", 6.3, 0.06, -0.5))
"""Joint, middle [s], deviation [s] and height [N·m] of each; a bell in time."""
RATE, SECONDS = 250.0, 7.5


def recorded(
    pushes: tuple[tuple[str, float, float, float], ...], machine: str = MACHINE
) -> Recording:
    """A machine under smooth torques, with the noise of encoders."""
    model = mujoco.MjModel.from_xml_string(machine)
    data, t = mujoco.MjData(model), np.arange(round(SECONDS * RATE)) / RATE
    u = np.stack([0.9 * np.sin(3.1 * t) + 0.4 * np.sin(7.3 * t), 0.35 * np.sin(4.7 * t + 1.0)], 1)
    q, v = np.empty_like(u), np.empty_like(u)
    for k, command in enumerate(u):
        q[k], v[k] = data.qpos, data.qvel
        data.ctrl[:] = command
        for _ in range(round(1.0 / (RATE * model.opt.timestep))):
            data.qfrc_applied[:] = 0.0
            for joint, middle, deviation, height in pushes:
                bell = np.exp(-0.5 * ((data.time - middle) / deviation) ** 2)
                data.qfrc_applied[model.joint(joint).dofadr[0]] += height * bell
            mujoco.mj_step(model, data)
    rng = np.random.default_rng(0)
    q += 2e-4 * rng.standard_normal(q.shape)
    v += 0.05 * rng.standard_normal(v.shape)
    columns = {f"ctrl/m{i + 1}": u[:, i] for i in range(2)}
    columns |= {f"qpos/{j}": q[:, i] for i, j in enumerate(("shoulder", "elbow"))}
    columns |= {f"qvel/{j}": v[:, i] for i, j in enumerate(("shoulder", "elbow"))}
    return Recording(t, columns, {})


def found(whole: Smoothed, log: DecisionLog | None = None) -> tuple[Event, ...]:
    def replays() -> Objective:
        return Objective(whole, stretches_of(whole, False), 1e-3, False)

    # as a search finds it
    dry = effects()["joint.friction_coulomb"]
    known = [Planted(dry, Location("joint", j), np.array([0.08])) for j in ("shoulder", "elbow")]
    return events(whole.motion, replays, tuple(known), DecisionLog() if log is None else log)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    path = tmp_path / "pendulum.xml"
    path.write_text(MODEL)
    return Scene(path)


def test_each_push_is_found_with_its_joint_time_and_size(scene: Scene) -> None:
    shown = found(smooth(scene, [Part(recorded(PUSHES), 0)]))
    listed = []
    for event in shown:
        effect = event.planted.effect
        assert isinstance(effect, ForceIntermittent) and event.gain.p_value < 1e-3
        assert event.gain.share > THRESHOLDS.momentary_share
        for push, height in zip(effect.pushes, event.planted.theta, strict=True):
            middle = 0.5 * (push.start + push.end)
            t = np.linspace(0.0, SECONDS, 9001)
            impulse = float(height * np.trapezoid(push.course(t), t))
            listed.append((middle, event.planted.at.name, impulse))
    assert len(listed) == len(PUSHES)
    for one, push in zip(sorted(listed), sorted(PUSHES, key=lambda p: p[1]), strict=True):
        joint, middle, deviation, height = push
        assert one[1] == joint
        assert one[0] == pytest.approx(middle, abs=0.05)
        assert one[2] == pytest.approx(height * deviation * np.sqrt(2.0 * np.pi), rel=0.2)


def test_moments_that_explain_little_are_no_pushes(scene: Scene) -> None:
    """Beside all that a far too light and smooth model errs by, a push proves nothing."""
    recording = recorded((("elbow", 4.1, 0.09, -0.4),), PENDULUM.format(0.03, 0.16, 0.8))
    log = DecisionLog()
    assert found(smooth(scene, [Part(recording, 0)]), log) == ()
    (said,) = [d for d in log if "explain little" in d.reason]
    assert said.statistic < THRESHOLDS.momentary_share


def test_friction_that_the_model_lacks_is_no_push(scene: Scene) -> None:
    assert found(smooth(scene, [Part(recorded(()), 0)])) == ()


@pytest.mark.parametrize(
    ("run", "true"),
    [
        ("acrobot_05", {"shoulder": (2.79, 6.03), "elbow": (1.27, 4.67)}),
        ("acrobot_07", {"shoulder": (4.56, 6.62), "elbow": (1.45, 2.99)}),
        ("unpushed_acrobot_01", {}),
        ("unpushed_pendubot_01", {}),
    ],
)
def test_pushes_on_a_real_double_pendulum(
    run: str, true: dict[str, tuple[float, ...]], from_shared: FromShared
) -> None:
    # the torques that were injected stand in the runs' own tau_pert
    recording = DfkiDoublePendulum().read(from_shared(f"recordings/dfki_pushed/{run}.csv"), {})
    motion = smooth(Scene(from_shared("cases/real/dp.xml")), [Part(recording, 0)]).motion
    for joint in ("shoulder", "elbow"):
        times = [0.5 * (p.start + p.end) for p in seen(motion, Location("joint", joint))]
        for middle in true.get(joint, ()):
            assert min(abs(t - middle) for t in times) < 0.05
        assert times == [] or joint in true


def test_what_only_makes_up_for_each_other_leaves_together(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A push at each joint at one moment, none of which may go alone, and one more elsewhere."""
    kind = effects()["joint.force_intermittent"]
    assert isinstance(kind, ForceIntermittent)

    def pushed(joint: str, *middles: float) -> _Found:
        pushes = [Push(0.0, t - 0.05, t + 0.05, 0.01, 1.0) for t in middles]
        planted = Planted(kind.shaped(flat(pushes)), Location("joint", joint), np.ones(len(pushes)))
        return _Found(planted, 0.1 * np.ones(len(pushes)))

    both = [pushed("shoulder", 2.0, 5.0), pushed("elbow", 2.03)]
    assert _at_once(both) == [[(0, 0), (1, 0)]]
    assert [len(f.spread) for f in _less(both, [(0, 0), (1, 0)])] == [1]

    def leads(objective: object, full: object, lesser: list[tuple[Planted, ...]]) -> list[float]:
        """The one at 5 s is needed; of those at 2 s both or none."""
        said = []
        for hypothesis in lesser:
            moments = [w for p in hypothesis for w in p.observed()["windows"][1][::2]]
            alone = sum(x < 3.0 for x in moments) == 1
            late = max(moments, default=0.0) > 4.0
            said.append((90.0 if alone else -1.0) + (0.0 if late else 50.0))
        return said

    monkeypatch.setattr("wt.diagnose.selection.events._leads", leads)
    replays = Mock(spec=Objective)
    replays.evaluate = list
    (left,) = _proven(replays, (), both, DecisionLog())
    assert left.planted.at.name == "shoulder"
    assert left.planted.observed()["windows"][1] == pytest.approx((4.95, 5.05), abs=0.02)
