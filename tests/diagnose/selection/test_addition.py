"""The best addition is judged with tolerances as they adapt around itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import on_joint, world
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.refine import around_itself, refine, slopes_at, slopes_of
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection.addition import (
    Accepted,
    Incumbent,
    _alike,
    addition,
    replacement,
)
from wt.diagnose.selection.decisions import DecisionLog
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

LINK = """\
<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body name="link"><joint name="hinge" axis="0 1 0" damping=".1"{hidden}/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1.2"/></body></worldbody>
<actuator><{drive} name="servo" joint="hinge"/></actuator></mujoco>
"""
STAGE = """\
<mujoco><option timestep="0.001"/><worldbody><body name="carriage">
<joint name="x" type="slide" damping="10"{hidden}/><geom size=".05" mass="1"/></body></worldbody>
<actuator><velocity name="drive" joint="x" kv="100"/></actuator></mujoco>
"""
SERVO, MOTOR = 'position kp="90" kv="5"', "motor"
RATE, NOISE = 100, 1e-5  # Hz; rad: so quiet that what is linear in the tolerances falls short


def record(hidden: str, drive: str, seconds: float, noise: float, seed: int) -> Recording:
    """A multisine with steps; a motor follows it by the torques of a loop that sees the truth."""
    model = mujoco.MjModel.from_xml_string(LINK.format(hidden=hidden, drive=drive))
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    rate, phase = rng.uniform(0.15, 1.2, 4), rng.uniform(0.0, 6.28, 4)
    u = 0.2 * np.sin(2.0 * np.pi * t[:, None] * rate + phase).sum(axis=1)
    u = (u + 0.3 * (np.floor(t / 1.7) % 2)) * np.minimum(t / 2.0, 1.0)
    q = np.empty(len(t))
    for k in range(len(t)):
        q[k] = data.qpos[0]
        if drive == MOTOR:
            u[k] = 40.0 * (u[k] - data.qpos[0]) - 2.0 * data.qvel[0]
        data.ctrl[:] = u[k]
        mujoco.mj_step(model, data, 20)
    q += noise * rng.standard_normal(len(t))
    return Recording(t, {"qpos/hinge": q, "ctrl/servo": u})


def joined(
    folder: Path,
    hidden: str,
    drive: str,
    seconds: float,
    noise: float,
    seed: int,
    given: str = "",
) -> list[Accepted]:
    """What joins first where that is hidden, and a model has something else or nothing."""
    path = folder / "link.xml"
    path.write_text(LINK.format(hidden=given, drive=drive))
    fitted = smooth(Scene(path), [Part(record(hidden, drive, seconds, noise, seed), 0)])
    screen = Screen(fitted, 0)
    replays = stretches_of(fitted, forgets=True)
    objective = Objective(fitted, replays, 1e-3, True)
    return addition(screen, objective, objective.reference(()), [], DecisionLog(), 4)


@pytest.mark.long
def test_a_rotor_is_not_taken_for_an_elastic_gear(tmp_path: Path) -> None:
    (rotor,) = joined(tmp_path, ' armature=".03"', SERVO, 10.0, NOISE, seed=4)
    assert rotor.planted.effect.id == "joint.armature"
    assert rotor.planted.theta == pytest.approx([0.03], rel=0.05)


@pytest.mark.parametrize(("true", "less"), [(0.002, 0.028), (0.03, 0.0)])
def test_a_model_may_have_too_large_a_rotor(tmp_path: Path, true: float, less: float) -> None:
    """As of another gear; what any rotor may be off by (8 g·m² here) need not be part of it."""
    hidden, given = f' armature="{true}"', ' armature=".03"'
    found = joined(tmp_path, hidden, SERVO, 5.0, NOISE, seed=4, given=given)
    assert [f.planted.effect.id for f in found] == ["joint.armature"] * bool(less)
    for f in found:
        assert f.planted.theta == pytest.approx([-less], abs=0.009)
        assert not f.planted.at_limit()
        assert "less rotor inertia" in f.planted.effect.statement(f.planted.at, f.planted.theta)


@pytest.mark.long
def test_a_spring_is_judged_on_the_model_as_it_is(tmp_path: Path) -> None:
    """Without it the model errs by half a radian and bends all that it may to make up for that."""
    hidden = ' stiffness="3.2" springref=".4"'
    (spring,) = joined(tmp_path, hidden, MOTOR, 11.0, 1e-3, seed=1)
    assert spring.planted.effect.id == "joint.stiffness"
    assert spring.planted.theta == pytest.approx([3.2, 0.4], rel=0.02)


def test_which_form_a_law_has_is_asked_near_its_parameters(tmp_path: Path) -> None:
    """Friction that creeps by a tenth of the motion; from afar one form or the other may be ahead.

    If it were kept for that, a dead band would leave less.
    """
    model = mujoco.MjModel.from_xml_string(STAGE.format(hidden=' frictionloss="15"'))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    t = np.arange(12 * RATE) / RATE
    rate, phase = rng.uniform(0.15, 1.2, 4), rng.uniform(0.0, 6.28, 4)
    u = 0.1 * np.sin(2.0 * np.pi * t[:, None] * rate + phase).sum(axis=1)
    x = np.empty(len(t))
    for k in range(len(t)):
        x[k], data.ctrl[:] = data.qpos[0], u[k]
        mujoco.mj_step(model, data, 10)
    x += 2e-5 * rng.standard_normal(len(t))
    path = tmp_path / "stage.xml"
    path.write_text(STAGE.format(hidden=""))
    recording = Recording(t, {"qpos/x": x, "ctrl/drive": u})
    fitted = smooth(Scene(path), [Part(recording, 0)])
    objective = Objective(fitted, stretches_of(fitted, forgets=False), 1e-3, False)
    (found,) = addition(Screen(fitted, 0), objective, objective.reference(()), [], DecisionLog(), 4)
    assert found.planted.effect.id == "joint.friction_coulomb"
    assert "creeps" in found.planted.effect.form
    assert found.planted.theta == pytest.approx([15.0], rel=0.02)


def test_in_the_place_of_an_effect_comes_what_acts_there_or_looks_alike(tmp_path: Path) -> None:
    """What acts on all joints is not looked for once more at each of them."""
    nothing = world(tmp_path, 3, None, 2.5)

    def places(name: str, kind: str, at: str) -> set[tuple[str, str]]:
        alike = _alike(nothing.screen, planted(name, kind, at))
        asked = [(n, a) for n, k, a in OPTIONS if (n, Location(k, a)) in alike]
        return set(asked)

    gravity, late = ("world.gravity", "world"), ("actuator.delay", "a3")
    here = ("joint.friction_coulomb", "j1")
    assert places("joint.friction_viscous", "joint", "j1") == {here, gravity}
    assert places("sensor.delay", "sensor", "all") == {gravity, late}


def test_what_nothing_comes_close_to_keeps_its_place(tmp_path: Path) -> None:
    path = tmp_path / "link.xml"
    path.write_text(LINK.format(hidden="", drive=SERVO))
    recording = record(' frictionloss="1.5"', SERVO, 5.0, 1e-4, seed=2)
    fitted = smooth(Scene(path), [Part(recording, 0)])
    objective = Objective(fitted, stretches_of(fitted, forgets=True), 1e-3, True)
    now, screen = objective.reference(()), Screen(fitted, 0)

    def instead(name: str) -> str | None:
        (fit,) = refine(objective, [(planted(name, "joint", "hinge"),)], [[0]], 6)
        found = Incumbent(fit.hypothesis[0], fit.loglik)
        other = replacement(screen, objective, now, [], DecisionLog(), (), found)
        return other.planted.effect.id if other else None

    assert instead("joint.friction_coulomb") is None
    assert instead("joint.stiffness") == "joint.friction_coulomb"


def rub(_: float, v: float) -> float:
    """Dry friction."""
    return float(-0.8 * np.tanh(v / 0.01))


def test_around_itself_what_others_change_is_not_replayed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden = world(tmp_path, 2, on_joint(0, rub), 2.5)
    objective = hidden.objective
    both = (planted("joint.friction_coulomb", "joint", "j1"),
            planted("joint.friction_viscous", "joint", "j2"))  # fmt: skip
    now = objective.reference(both)
    known = slopes_of(now.hypothesis, slopes_at(objective, now))
    asked, errors = list[int](), objective.errors

    def counted(hypotheses: Sequence[Hypothesis], centres: object) -> np.ndarray:
        asked.append(len(hypotheses))
        return errors(hypotheses, centres)  # type: ignore[arg-type]

    monkeypatch.setattr(objective, "errors", counted)
    del known[both[0].key]
    fit = around_itself(objective, now, now, [0], known)
    assert asked and set(asked) == {1}  # one figure of one law
    assert fit.loglik > now.loglik + 10.0


OPTIONS = (
    ("joint.friction_coulomb", "joint", "j1"),
    ("joint.friction_coulomb", "joint", "j2"),
    ("joint.friction_quadratic", "joint", "j2"),
    ("actuator.delay", "actuator", "a3"),
    ("world.gravity", "world", "world"),
)


def planted(name: str, kind: str, at: str) -> Planted:
    effect = effects()[name]
    return Planted(effect, Location(kind, at), np.ones(effect.n_theta))
