"""Laws that are no different from a simpler one, as far as the recordings tell."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import World, chain, on_joint, world
from wt.diagnose.likelihood.bic import erring_joints
from wt.diagnose.likelihood.estimate import estimate
from wt.diagnose.selection import simpler
from wt.diagnose.selection.addition import Accepted
from wt.diagnose.selection.decisions import DecisionLog
from wt.diagnose.selection.search import _fitted
from wt.diagnose.selection.simpler import by_what_they_became, simplified, united
from wt.physics.effect import effects
from wt.physics.hooks import Nested, Uniting
from wt.physics.planted import Planted
from wt.types import Location

J2, A2 = Location("joint", "j2"), Location("actuator", "a2")
LOAD = effects()["joint.friction_load"]
STRIBECK = effects()["joint.friction_stribeck"]
MOVING = effects()["body.payload_moving"]


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A chain with dry friction in j2, and nothing else."""
    friction = on_joint(1, lambda q, v: -0.3 * float(np.tanh(v / 1e-3)))
    return world(tmp_path_factory.mktemp("rubbing"), 2, friction, 5.0)


@pytest.mark.long
def test_friction_that_no_load_changes_is_coulombs(rubbing: World) -> None:
    planted = Planted(LOAD, J2, np.array([0.28, 0.01]))
    coulomb = Planted(effects()["joint.friction_coulomb"], J2, np.array([0.29]))
    stribeck = Planted(STRIBECK, J2, np.array([0.28, 0.3, 0.1]))
    given = (Accepted(planted, None, (coulomb, stribeck)),)
    before = estimate(rubbing.objective, (planted,))
    assert before.estimates[0]["fraction"].ci95[0] == 0.0
    accepted, after = simplified(rubbing.objective, given, before, DecisionLog())
    assert [a.planted.effect.id for a in accepted] == ["joint.friction_coulomb"]
    rivals = [r.effect.id for r in accepted[0].rivals]
    assert rivals == [LOAD.id, STRIBECK.id], "a law must not be its own rival"
    assert accepted[0].shape == ()
    assert after.estimates[0]["coulomb"].value == pytest.approx(0.3, rel=0.03)


def test_bristles_that_slide_nearly_all_the_way_are_coulombs(rubbing: World) -> None:
    hysteresis = effects()["joint.hysteresis"]
    planted = Planted(hysteresis, J2, np.array([30.0, 0.3]))
    before = estimate(rubbing.objective, (planted,))
    accepted, after = simplified(
        rubbing.objective, (Accepted(planted, (0.01,), ()),), before, DecisionLog()
    )
    assert [a.planted.effect.id for a in accepted] == ["joint.friction_coulomb"]
    assert [r.effect.id for r in accepted[0].rivals] == ["joint.hysteresis"]
    assert after.estimates[0]["coulomb"].value == pytest.approx(0.3, rel=0.03)
    # half a radian of spring is more than bristles bend
    soft = Planted(hysteresis, J2, np.array([0.6, 0.3]))
    assert soft.simpler(rubbing.screen.motion, {}) is None


def test_what_becomes_a_simpler_law_is_that_and_not_dropped(rubbing: World) -> None:
    """As friction that differed with the direction until something else was known."""
    motion, objective = rubbing.objective.motion, rubbing.objective
    directional, coulomb = (effects()[f"joint.friction_{n}"] for n in ("directional", "coulomb"))
    differs = Planted(directional, J2, np.array([0.4, 0.2, 0.0, 0.0]))
    assert differs.become(motion) is None
    assert Planted(directional, J2, np.array([0.5, 0.0, 0.0, 0.0])).become(motion) is None
    whole = Planted(directional.shaped((0.0, 0.3)), J2, np.array([0.25, 0.25, 0.3, 0.3]))
    law = whole.become(motion)  # all of it, of which the model has the damping
    assert law is not None and law.effect is coulomb and law.theta == pytest.approx([0.25])
    alike = Planted(directional, J2, np.array([0.25, 0.24, 0.0, 0.0]))
    given, log = [Accepted(alike, (), ())], DecisionLog()
    accepted, hypothesis = by_what_they_became(objective, given, (alike,), log)
    after = _fitted(objective, hypothesis)
    assert [a.planted.effect.id for a in accepted] == [coulomb.id] and accepted[0].shape == ()
    assert after.hypothesis[0].theta == pytest.approx([0.3], rel=0.05)
    assert [(d.stage, d.kept) for d in log] == [("simplified", False)]
    # what another says already is not said twice
    both = (alike, Planted(coulomb, J2, np.array([0.05])))
    given.append(Accepted(both[1], (), ()))
    accepted, hypothesis = by_what_they_became(objective, given, both, log)
    after = _fitted(objective, hypothesis)
    assert accepted == given[1:]
    assert after.hypothesis[0].theta == pytest.approx([0.3], rel=0.05)
    same = both[1:]
    assert by_what_they_became(objective, accepted, same, log) == (accepted, same)


@pytest.mark.long
def test_legs_lose_a_law_that_gains_too_few_nats(
    rubbing: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted = Planted(STRIBECK, J2, np.array([0.3, 0.1, 0.05]))
    before = estimate(rubbing.objective, (planted,))
    # on legs which joints err is a matter of chance
    noisy = iter([[0], [0, 1]])
    monkeypatch.setattr(simpler, "erring_joints", lambda objective, fit: next(noisy))
    accepted, _ = simplified(
        rubbing.objective, (Accepted(planted, None, ()),), before, DecisionLog()
    )
    assert [a.planted.effect.id for a in accepted] == ["joint.friction_coulomb"]


@pytest.fixture(scope="module")
def two_ways(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A chain whose model has friction in j2, of one size, where it is of two."""
    friction = on_joint(1, lambda q, v: (0.2 if v < 0.0 else -0.4) * float(np.tanh(abs(v) / 1e-3)))
    at = '<joint name="j2" axis="0 0 1" damping=".3"/>'
    model = chain(2).replace(at, at.replace("/>", ' frictionloss=".3"/>'))
    assert model != chain(2)
    return world(tmp_path_factory.mktemp("two"), 2, friction, 3.0, model=model)


@pytest.mark.long
def test_what_another_law_has_in_it_is_not_said_twice(two_ways: World) -> None:
    whole = effects()["joint.friction_directional"].shaped((0.3, 0.3))
    both = Planted(whole, J2, np.array([0.4, 0.2, 0.3, 0.3]))
    planted = both, Planted(LOAD, J2, np.array([0.01, 0.01]))
    before = estimate(two_ways.objective, planted)
    given = tuple(Accepted(p, None, ()) for p in planted)
    accepted, after = simplified(two_ways.objective, given, before, DecisionLog())
    assert [a.planted.effect.id for a in accepted] == ["joint.friction_directional"]
    assert len(after.hypothesis) == 1


LINK2 = Location("body", "link2")
LOAD_AT = np.array([0.05, 0.02, -0.2])


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A chain with .3 kg at its second link."""
    x, y, z = LOAD_AT
    link = '<geom type="capsule" fromto="0 0 0 .03 .02 -.25" size=".03" mass="1.05"/>'
    weight = f'{link}<geom type="sphere" size=".005" pos="{x} {y} {z}" mass=".3"/>'
    return world(
        tmp_path_factory.mktemp("loaded"), 2, None, 4.0, machine=chain(2).replace(link, weight)
    )


def test_a_load_says_alone_what_mass_and_centre_of_mass_do_together(loaded: World) -> None:
    payload, scene = effects()["body.payload_fixed"], loaded.scene
    mass, centre = 1.05, scene.model.body("link2").ipos
    shift = 0.3 * (LOAD_AT - centre) / (mass + 0.3)
    thetas = {"body.mass": np.array([1.0 + 0.3 / mass]), "body.com": shift}
    parts = tuple(Planted(effects()[name], LINK2, theta) for name, theta in thetas.items())
    motion = loaded.screen.motion
    assert isinstance(payload, Uniting)
    here = {(name, LINK2): theta for name, theta in thetas.items()}
    assert payload.union(motion, LINK2, here) == pytest.approx([0.3, *LOAD_AT])
    lighter = {**here, ("body.mass", LINK2): np.array([0.8])}
    assert payload.union(motion, LINK2, lighter) is None
    before = estimate(loaded.objective, parts)
    given = tuple(Accepted(p, (), ()) for p in parts)
    accepted, after = united(loaded.objective, given, before, DecisionLog())
    assert [a.planted.effect.id for a in accepted] == ["body.payload_fixed"]
    assert after.estimates[0]["mass"].value == pytest.approx(0.3, rel=0.05)
    assert {r.effect.id for r in accepted[0].rivals} == set(thetas)


def test_a_load_says_alone_what_a_nearer_one_and_a_centre_of_mass_do_together(
    loaded: World,
) -> None:
    """Its weight is on one body and its lever on the next."""
    link1, hinge = Location("body", "link1"), loaded.scene.model.body("link2").pos
    parts = (
        Planted(effects()["body.payload_fixed"], link1, np.array([0.3, *hinge])),
        Planted(effects()["body.com"], LINK2, 0.3 / 1.05 * LOAD_AT),
    )
    payload = parts[0].effect
    assert isinstance(payload, Uniting)
    assert payload.near(loaded.scene, LINK2) == (link1,)
    assert payload.near(loaded.scene, Location("body", "all")) == ()
    both = {(p.effect.id, p.at): p.theta for p in parts}
    theta = payload.union(loaded.screen.motion, LINK2, both)
    assert theta == pytest.approx([0.3, *LOAD_AT])
    given = tuple(Accepted(p, (), ()) for p in parts)
    before = estimate(loaded.objective, parts)
    accepted, after = united(loaded.objective, given, before, DecisionLog())
    assert [(a.planted.effect.id, a.planted.at) for a in accepted] == [(payload.id, LINK2)]
    assert after.estimates[0]["mass"].value == pytest.approx(0.3, rel=0.05)


def test_a_gear_says_alone_what_friction_by_load_and_by_speed_do_together(tmp_path: Path) -> None:
    """Each of the two excludes it, so that it is tried in the place of both."""
    losses = np.array([0.1, 0.45, 0.05, 0.1])

    def lossy(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        q, v = float(data.qpos[0]), float(data.qvel[0])
        drive = 80.0 * (float(data.ctrl[0]) - q) - 4.0 * v
        share = losses[0] if drive * v > 0.0 else losses[1]
        level = losses[2] + losses[3] * abs(v) + share * abs(drive)
        data.qfrc_applied[0] -= level * float(np.tanh(v / 1e-3))

    geared, at = world(tmp_path, 1, lossy, 5.0), Location("joint", "j1")
    gear = effects()["joint.gear_loss"]
    thetas = {
        "joint.friction_load": np.array([0.05, 0.28]),
        "joint.friction_viscous": np.array([0.1]),
    }
    motion = geared.screen.motion
    assert isinstance(gear, Uniting)
    here = {(name, at): theta for name, theta in thetas.items()}
    assert gear.union(motion, at, here) == pytest.approx([0.28, 0.28, 0.05, 0.1])
    slow = {(f"joint.friction_{kind}", at): np.array([0.1]) for kind in ("coulomb", "viscous")}
    assert gear.union(motion, at, slow) is None
    parts = tuple(Planted(effects()[name], at, theta) for name, theta in thetas.items())
    given = tuple(Accepted(p, (), ()) for p in parts)
    before = estimate(geared.objective, parts)
    accepted, after = united(geared.objective, given, before, DecisionLog())
    assert [a.planted.effect.id for a in accepted] == ["joint.gear_loss"]
    assert after.hypothesis[0].theta == pytest.approx(losses, abs=0.05)
    assert {r.effect.id for r in accepted[0].rivals} == set(thetas)


@pytest.mark.parametrize(
    ("name", "theta", "with_more", "with_too_little"),
    [
        ("joint.friction_stribeck", [0.1, 0.3, 0.2], [0.3, 0.5, 0.2], -0.11),
        ("joint.friction_load", [0.1, 0.3], [0.3, 0.3], -0.11),
        ("joint.friction_position", [0.1, 0.6, 2.0, 1.0], [0.3, 0.2, 2.0, 1.0], -0.06),
    ],
)
def test_laws_with_dry_friction_in_them_say_what_stands_beside_them(
    two_ways: World, name: str, theta: list[float], with_more: list[float], with_too_little: float
) -> None:
    law = effects()[name]
    assert isinstance(law, Uniting)
    for dry, united_theta in ((0.2, with_more), (with_too_little, None)):
        parts = {name: np.array(theta), "joint.friction_coulomb": np.array([dry])}
        assert set(parts) == set(law.unites)
        here = {(id_, J2): sizes for id_, sizes in parts.items()}
        found = law.union(two_ways.screen.motion, J2, here)
        assert found is None if united_theta is None else found == pytest.approx(united_theta)
    alone = {("joint.friction_coulomb", J2): np.ones(1)}
    assert law.union(two_ways.screen.motion, J2, alone) is None


def test_friction_that_falls_with_speed_is_said_once(tmp_path: Path) -> None:
    """Beside dry friction what is left of it is larger at rest, too."""

    def falls(q: float, v: float) -> float:
        return -(0.1 + 0.25 * float(np.exp(-((v / 0.3) ** 2)))) * float(np.tanh(v / 1e-3))

    sticky = world(tmp_path, 2, on_joint(1, falls), 5.0)
    thetas = {"joint.friction_coulomb": [0.1], "joint.friction_stribeck": [0.0, 0.25, 0.3]}
    parts = tuple(Planted(effects()[name], J2, np.array(x)) for name, x in thetas.items())
    given = tuple(Accepted(p, (), ()) for p in parts)
    before = estimate(sticky.objective, parts)
    accepted, after = united(sticky.objective, given, before, DecisionLog())
    assert [a.planted.effect.id for a in accepted] == ["joint.friction_stribeck"]
    assert after.hypothesis[0].theta == pytest.approx([0.1, 0.35, 0.3], rel=0.25)


def test_a_law_is_needed_where_something_else_is_left_beside_it(tmp_path: Path) -> None:
    """What errs anyway is no reason to err by ten times as much."""
    yields, stiffness, last = 0.3, 3.0, [0.0, 0.0]  # bent by a tenth of a radian

    def grips(q: float, v: float) -> float:
        last[1] = float(np.clip(last[1] + stiffness * (q - last[0]), -yields, yields))
        last[0] = q
        return -last[1] + 0.15 * float(np.sin(14.0 * q))

    gripped = world(tmp_path, 2, on_joint(1, grips), 5.0)
    planted = Planted(effects()["joint.hysteresis"], J2, np.array([stiffness, yields]))
    before = estimate(gripped.objective, (planted,))
    assert erring_joints(gripped.objective, before.assessed)
    assert before.hypothesis[0].simpler(gripped.screen.motion, {}) is not None
    accepted, _ = simplified(
        gripped.objective, (Accepted(planted, (0.1,), ()),), before, DecisionLog()
    )
    assert [a.planted.effect.id for a in accepted] == ["joint.hysteresis"]


def test_what_is_needed_stays(rubbing: World) -> None:
    motion = rubbing.screen.motion
    load = float(np.abs(motion.drive_forces[:, 1]).mean())
    theta = np.array([0.1, 0.2])
    assert LOAD.simpler(motion, J2, theta, {"fraction": (0.1, 0.3)}) is None
    law, values = LOAD.simpler(motion, J2, theta, {"fraction": (0.0, 0.4)})  # type: ignore[misc]
    assert law == "joint.friction_coulomb" and values == pytest.approx([0.1 + 0.2 * load])
    rise = np.array([0.1, 0.3, 0.1])
    assert STRIBECK.simpler(motion, J2, rise, {"coulomb": (0.0, 0.2), "static": (0.25, 1)}) is None
    found = STRIBECK.simpler(motion, J2, rise, {"coulomb": (0.0, 0.2), "static": (0.15, 1)})
    assert found is not None and found[1] == pytest.approx([0.1])
    moving = np.array([0.5, 0.8, 0.1, 0.0, -0.2])
    assert MOVING.simpler(motion, LINK2, moving, {"travel": (0.2, 1.0)}) is None
    found = MOVING.simpler(motion, LINK2, moving, {"travel": (0.001, 2.0)})
    assert found is not None and found[0] == "body.payload_fixed"
    assert found[1] == pytest.approx([0.5, 0.1, 0.0, -0.2])


def test_a_load_that_adds_next_to_nothing_is_none(rubbing: World) -> None:
    motion = rubbing.screen.motion
    load = float(np.abs(motion.drive_forces[:, 1]).mean())
    assert not LOAD.plausible(motion, J2, np.array([1.0, 0.03 / load]))
    assert LOAD.plausible(motion, J2, np.array([1.0, 0.1 / load]))


def test_a_limit_that_may_be_the_same_at_all_speeds_is_a_saturation(rubbing: World) -> None:
    motion, limit = rubbing.screen.motion, effects()["actuator.speed_limit"]
    fastest = float(np.abs(motion.v[:, 1]).max())
    theta = np.array([0.8, 3.0 * fastest])
    assert isinstance(limit, Nested)
    falls = {"speed": (2.0 * fastest, 4.0 * fastest)}
    assert limit.simpler(motion, A2, theta, falls) is None
    found = limit.simpler(motion, A2, theta, {"speed": (2.0 * fastest, 1e6)})
    assert found is not None and found[0] == "actuator.saturation"
    assert found[1] == pytest.approx([0.8])


def test_a_load_whose_weight_does_not_show_is_a_centre_of_mass(rubbing: World) -> None:
    motion, load = rubbing.screen.motion, effects()["body.payload_fixed"]
    theta, own = (
        np.array([60.0, 0.002, 0.0, -0.004]),
        float(motion.scene.model.body("link2").mass[0]),
    )
    assert isinstance(load, Nested)
    assert load.simpler(motion, LINK2, theta, {"mass": (0.1, 120.0)}) is None
    found = load.simpler(motion, LINK2, theta, {"mass": (0.0, 120.0)})
    assert found is not None and found[0] == "body.com"
    assert found[1] == pytest.approx(60.0 / own * theta[1:])
