"""Laws that look alike are told apart by everything that was recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import RATE, World, chain, on_joint, world
from wt.diagnose.likelihood.bic import worth
from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.residual.screen import Screen
from wt.diagnose.selection import alternatives
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.alternatives import (
    Lookalikes,
    Option,
    _best,
    _each_settled,
    _rivals,
)
from wt.diagnose.selection.candidates import dof_of, near
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

JOINT, DRIVE = Location("joint", "j1"), Location("actuator", "a1")
SENSORS, DRIVES = Location("sensor", "all"), Location("actuator", "all")
PUSH, LATE = 0.5, 0.02
ASTRAY = (0.02, 6.0, 0.02)  # Stribeck's friction from where replays lead nowhere


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A pendulum that is pushed by a constant torque."""
    return world(tmp_path_factory.mktemp("pushed"), 1, on_joint(0, lambda q, v: PUSH), 3.0)


@pytest.fixture(scope="module")
def sticky(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A pendulum with dry friction that is larger near standstill."""
    law = on_joint(
        0, lambda q, v: -float(np.tanh(v / 2e-3)) * (0.3 + 0.3 * float(np.exp(-((v / 0.05) ** 2))))
    )
    return world(tmp_path_factory.mktemp("sticky"), 1, law, 3.0)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Two joints whose log has every command 20 ms before the drives act on it."""

    def early(recording: Recording) -> Recording:
        k = round(LATE * RATE)
        columns = {
            name: x[k:] if name.startswith("ctrl/") else x[:-k]
            for name, x in recording.columns.items()
        }
        return Recording(recording.t[:-k], columns)

    return world(tmp_path_factory.mktemp("late"), 2, None, 4.0, log=early)


def lookalikes(some: World) -> Lookalikes:
    return Lookalikes(
        some.screen, some.objective, some.objective, lambda: some.objective, DecisionLog()
    )


def settled(some: World, effect: str, at: Location, *theta: float) -> Accepted:
    planted = Planted(effects()[effect], at, np.array(theta))
    shape = next(iter(planted.effect.shapes(some.screen.motion, at)), None)
    given = (Accepted(planted, shape, ()),)
    (found,), estimated = lookalikes(some).settled(given, estimate(some.objective, (planted,)))
    assert estimated.hypothesis[0].key == found.planted.key
    return found


def test_a_law_that_only_looks_like_the_right_one_gives_way_to_it(pushed: World) -> None:
    found = settled(pushed, "sensor.offset", JOINT, 0.01)
    assert found.planted.effect.id == "actuator.bias" and found.planted.at == DRIVE
    assert found.planted.theta == pytest.approx([PUSH], rel=0.02)


def test_the_right_law_stays(pushed: World) -> None:
    found = settled(pushed, "actuator.bias", DRIVE, PUSH)
    assert found.planted.effect.id == "actuator.bias"
    # a stiff servo on a light link hardly tells where the encoder's zero is
    assert "sensor.offset" in {r.effect.id for r in found.rivals}
    assert "joint.stiffness" not in {r.effect.id for r in found.rivals}


def test_a_contradicted_effect_beside_it_hides_no_rival(tmp_path: Path) -> None:
    some = world(tmp_path, 2, on_joint(1, lambda q, v: PUSH), 3.0)
    bias = Planted(effects()["actuator.bias"], Location("actuator", "a2"), np.array([PUSH]))
    middle = float(np.median(some.objective.motion.q[:, 0]))
    stop = Planted(effects()["joint.stop"], JOINT, np.array([middle, 1.0]))
    assert stop.wrong(some.objective.motion)
    given = Accepted(stop, None, ()), Accepted(bias, None, ())
    present = estimate(some.objective, (stop, bias))
    (_, found), _ = lookalikes(some).settled(given, present, {stop.key})
    assert found.planted.effect.id == "actuator.bias"
    assert "sensor.offset" in {r.effect.id for r in found.rivals}


@pytest.mark.parametrize(
    ("effect", "at"), [("sensor.delay", SENSORS), ("actuator.delay", DRIVES)], ids=["late", "early"]
)
def test_late_commands_are_claimed_and_late_sensors_confusable(
    late: World, effect: str, at: Location
) -> None:
    found = settled(late, effect, at, LATE)
    assert found.planted.key == ("actuator.delay", "actuator", "all")
    assert found.planted.theta == pytest.approx([LATE], rel=0.02)
    assert [r.key for r in found.rivals] == [("sensor.delay", "sensor", "all")]


def option(effect: str, lead: float, evidence: float) -> Option:
    return Option(Planted(effects()[effect], JOINT, np.array([1.0])), lead, evidence)


def test_what_cannot_be_told_apart_is_called_by_the_more_usual_name() -> None:
    first, usual = option("joint.hysteresis", 0.0, 0.0), option("joint.friction_coulomb", -3.0, -3)
    assert _best([first, usual]) is usual
    assert _best([first, option("joint.friction_coulomb", -5.0, -5.0)]) is first
    assert _best([usual, option("joint.hysteresis", 0.9, 0.9)]) is usual
    ahead = option("joint.hysteresis", 5.0, 5.0)
    assert _best([usual, ahead]) is ahead


def test_how_rare_an_effect_is_tells_nothing_apart() -> None:
    first = option("actuator.bias", 0.0, 0.0)
    rare, wrong = option("sensor.offset", -8.0, 0.0), option("actuator.deadband", -5.0, -5.0)
    assert _rivals([first, wrong, rare], first) == [rare]
    usual = option("joint.friction_coulomb", -1.0, -1.0)
    assert _rivals([first, rare, usual], first) == [usual, rare]


def test_each_law_is_compared_with_tolerances_around_itself(tmp_path: Path) -> None:
    """Around dry friction they are bent, and what the load adds to it seemed worth 50 nats less."""

    def rubs(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        size = 0.3 + 0.3 * abs(float(data.qfrc_actuator[0]))
        data.qfrc_applied[0] -= size * float(np.tanh(data.qvel[0] / 2e-3))

    weak = chain(2).replace('kp="80"', 'kp="30"')
    heavier = weak.replace('mass="1.2"', 'mass="1.27"')
    some = world(tmp_path, 2, rubs, 6.0, machine=heavier, model=weak)
    dry, load = (
        Planted(effects()[f"joint.friction_{name}"], JOINT, np.array(theta))
        for name, theta in {"coulomb": [0.4], "load": [0.3, 0.1]}.items()
    )
    found = estimate(some.objective, (dry,)).assessed
    _, option = lookalikes(some)._compared(found.hypothesis, 0, [load])
    right = estimate(some.objective, (option.law,)).assessed
    lead = worth(some.objective, right, found) - THRESHOLDS.min_nats  # it is the larger law
    assert option.lead == pytest.approx(lead, abs=10.0)
    assert option.law.theta == pytest.approx([0.3, 0.3], abs=0.01)


def test_a_law_that_contains_what_was_found_is_never_hopeless(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside tolerances of dry friction Stribeck's was 72 nats behind it, beside its own 327 ahead.

    A servo with .22 N·m that sticks with .46 N·m was said to have .33 N·m of plain dry friction.
    """
    names = ("joint.friction_stribeck", "joint.friction_viscous")
    larger, other = (
        Mock(spec=Assessed, hypothesis=(Mock(spec=Planted, effect=effects()[name]),))
        for name in names
    )
    found = Mock(spec=Planted, beyond=lambda effect, motion: [()] if effect.id == names[0] else [])
    now, right = Mock(spec=Assessed, hypothesis=(found,)), Mock(spec=Assessed)
    monkeypatch.setattr(alternatives, "_is_bent", lambda fit: fit is not now)
    behind = {id(larger): -72.0, id(other): -72.0, id(right): 327.0}
    monkeypatch.setattr(alternatives, "worth", lambda _, fit, now: behind[id(fit)])
    again = Mock(return_value=right)
    monkeypatch.setattr(alternatives, "around_itself", again)
    objective = Mock(spec=Objective, scene=Mock(free=()), motion=Mock(spec=Motion))
    _, settled = _each_settled(objective, (found,), now, [larger, other], 0, {})
    assert settled == [right, other]
    again.assert_called_once_with(objective, larger, now, [0], {})


@pytest.mark.long
def test_a_larger_law_starts_from_the_one_it_contains(sticky: World) -> None:
    found = settled(sticky, "joint.friction_coulomb", JOINT, 0.35)
    assert found.planted.effect.id == "joint.friction_stribeck"
    assert found.planted.theta[:2] == pytest.approx([0.3, 0.6], rel=0.15)
    assert found.shape is not None


def test_a_larger_law_is_not_tried_where_nothing_is_left_for_it(pushed: World) -> None:
    bias = Planted(effects()["actuator.bias"], DRIVE, np.array([PUSH]))
    now = estimate(pushed.objective, (bias,)).assessed
    perfect = -float(pushed.objective.count @ np.log(pushed.objective.floor))
    for left, sizes in ((1.0, {1}), (100.0, {1, 2})):
        errs = replace(now, loglik=perfect - left)
        starts = lookalikes(pushed)._starts([Accepted(bias, (), ())], errs, 0)
        assert {p.effect.n_free for p, _ in starts} == sizes


def test_places_close_to_one_another_are_near(tmp_path: Path) -> None:
    (tmp_path / "chain.xml").write_text(chain(3))
    scene = Scene(tmp_path / "chain.xml")
    screen = Mock(spec=Screen, motion=Mock(spec=Motion, scene=scene))
    link, joint = Location("body", "link2"), Location("joint", "j2")
    drive, anywhere = Location("actuator", "a2"), Location("world", "world")
    assert {link, joint, drive} <= set(near(screen, joint))
    assert {link, joint} <= set(near(screen, drive))
    assert {x.name for x in near(screen, link) if x.kind == "body"} == {"link1", "link2", "link3"}
    assert joint in near(screen, link)
    links = [Location("body", f"link{i}") for i in (1, 2, 3)]
    assert near(screen, anywhere) == [anywhere, *links]  # a force on one may pass for a tilt
    assert dof_of(screen, drive) == 1 and dof_of(screen, DRIVES) == -1


def test_a_larger_law_that_was_led_astray_is_begun_anew(sticky: World) -> None:
    """A joint's Stribeck friction was refused, 300 nats ahead of Coulomb's, for where it began."""
    found = Planted(effects()["joint.friction_coulomb"], JOINT, np.array([0.35]))
    present = estimate(sticky.objective, (found,)).assessed
    astray = replace(found, effect=effects()["joint.friction_stribeck"], theta=np.array(ASTRAY))
    other = lookalikes(sticky)._instead(present, 0, Option(astray, 10.0, 10.0))
    assert other is not None
    assert other.hypothesis[0].theta[:2] == pytest.approx([0.3, 0.6], abs=0.06)
    assert other.loglik > present.loglik
