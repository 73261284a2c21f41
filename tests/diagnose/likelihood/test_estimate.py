"""Which of several effects may as well be nothing, and how well any of them can be known."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, chain, on_joint, record, world
from wt.diagnose.likelihood.estimate import (
    Estimated,
    distances_from_nothing,
    estimate,
    fitted,
    least_spread,
)
from wt.diagnose.likelihood.named import named
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.tolerances import absorbed, alike, tolerances
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.result import Estimate
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.planted import Hypothesis, Planted
from wt.physics.scene import Scene
from wt.physics.units import HINGE
from wt.types import Location

J = Location("joint", "j")
_MOTOR = r'<motor name="\1" joint="\2" gear="6"/>'


def test_the_small_error_of_a_finding_s_own_kind_is_part_of_it(tmp_path: Path) -> None:
    """Replays show only their sum: in a valley of the two, a third went to the tolerance."""
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="link"><joint name="j" damping=".3" armature=".02"/>'
        '<geom size=".1" mass="2" pos=".3 0 0"/></body></worldbody>'
        '<actuator><motor name="m" joint="j"/></actuator></mujoco>'
    )
    known = tolerances(Scene(path))
    for name, at, own, step in (
        ("joint.armature", J, 0.03, lambda t, x: 0.03 + x * t.tolerance.size),
        (
            "actuator.gain",
            Location("actuator", "m"),
            1.5,
            lambda t, x: 1.5 * (1.0 + x * t.tolerance.size),
        ),
    ):
        planted = Planted(effects()[name], at, np.array([own]))
        other = Planted(effects()["joint.stop"], J, np.array([1.0, 1.0]))
        mine = alike(known, (planted, other))
        assert [t.planted.key for t, m in zip(known, mine, strict=True) if m] == [planted.key]
        sizes = np.where(mine, 2.0, 1.0)
        whole, rest = absorbed(known, sizes, (planted, other))
        (tolerance,) = (t for t, m in zip(known, mine, strict=True) if m)
        np.testing.assert_allclose(whole.theta, step(tolerance, 2.0))
        assert rest == other


def estimated(*found: tuple[str, dict[str, tuple[float, float, float]]]) -> Estimated:
    """Effects with (lower end, value, upper end) of each parameter."""
    hypothesis = tuple(
        Planted(effects()[name], J, np.array([v for _, v, _ in values.values()]))
        for name, values in found
    )
    estimates = tuple(
        {name: Estimate(v, "-", (low, high)) for name, (low, v, high) in values.items()}
        for _, values in found
    )
    return Estimated(Mock(spec=Assessed, hypothesis=hypothesis), estimates)


def nearest_to_nothing(some: Estimated) -> int:
    distances = distances_from_nothing(some)
    return min(distances, key=distances.__getitem__)


def test_a_fit_does_not_end_far_below_a_place_that_it_has_been_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is linear around a place promises too much of the next: that one is left again."""
    rotor = Planted(effects()["joint.armature"], J, np.array([0.03]))

    def at(hypothesis: Hypothesis, centre: np.ndarray | None = None, **_: object) -> Mock:
        said = float(hypothesis[0].theta[0])
        there = 0.0 if centre is None else float(np.asarray(centre)[0])
        away = 1e6 * (said - 0.03) ** 2 + there**2
        return Mock(
            spec=Assessed, hypothesis=hypothesis, loglik=-away, centre=np.array([there]),
            tolerances=np.array([2.0]), error=np.zeros((4, 1)),
        )  # fmt: skip

    objective = Mock(spec=Objective, reference=at, tolerances=(), motion=None)
    module = "wt.diagnose.likelihood.estimate."
    monkeypatch.setattr(module + "steps", lambda *_: np.array([1e-4]))
    monkeypatch.setattr(module + "slopes_at", lambda *_: np.zeros((4, 1, 1)))
    monkeypatch.setattr(module + "refine", lambda _, starts, *__, **___: [at(starts[0])])
    monkeypatch.setattr(module + "alike", lambda *_: np.array([True]))
    monkeypatch.setattr(
        module + "absorbed",
        lambda _, __, now: (Planted(now[0].effect, J, now[0].theta + 0.01),),
    )
    found = fitted(objective, (rotor,))
    assert found.hypothesis[0].theta == pytest.approx([0.03])
    assert found.loglik == 0.0


def test_an_interval_that_holds_the_neutral_value_is_nothing_certain() -> None:
    friction = ("joint.friction_coulomb", {"coulomb": (0.0, 0.001, 0.002)})
    gain = ("actuator.gain", {"factor": (1.01, 1.1, 1.2)})
    assert nearest_to_nothing(estimated(gain, friction)) == 1
    assert distances_from_nothing(estimated(gain)) == {}
    assert nearest_to_nothing(estimated(("actuator.gain", {"factor": (0.9, 1.1, 1.2)}))) == 0


def test_the_nearest_to_nothing_goes_first() -> None:
    nearer = ("joint.friction_coulomb", {"coulomb": (0.0, 0.001, 0.4)})
    farther = ("joint.friction_viscous", {"coefficient": (-0.01, 0.19, 0.4)})
    assert nearest_to_nothing(estimated(farther, nearer)) == 1


def test_all_that_could_be_nothing_must_be() -> None:
    """Friction that only load makes has no constant part."""
    parts = {"coulomb": (0.0, 0.01, 0.03), "fraction": (0.1, 0.2, 0.3)}
    assert distances_from_nothing(estimated(("joint.friction_load", parts))) == {}


def test_an_effect_without_a_neutral_value_is_something() -> None:
    parts = {"stiffness": (0.01, 5.0, 10.0), "damping": (0.0, 0.0, 0.1)}
    assert distances_from_nothing(estimated(("joint.elasticity", parts))) == {}


def test_a_vector_is_nothing_where_all_of_it_may_be() -> None:
    force = Planted(effects()["body.force"], J, np.array([0.1, 0.0, 2.0]))
    ends = ((-0.1, -0.1, 1.0), (0.3, 0.1, 3.0))
    known = Estimated(
        Mock(spec=Assessed, hypothesis=(force,)),
        ({"force": Estimate((0.1, 0.0, 2.0), "N", ends)},),
    )
    assert distances_from_nothing(known) == {}
    ends = ((-0.1, -0.1, -1.0), (0.3, 0.1, 3.0))
    known = Estimated(known.assessed, ({"force": Estimate((0.1, 0.0, 2.0), "N", ends)},))
    assert nearest_to_nothing(known) == 0


def of_force(force: Planted, half: np.ndarray, visible: np.ndarray | None = None) -> Estimate:
    ends, smallest = (force.theta - half, force.theta + half), np.full(3, 0.01)
    visible = np.eye(3) if visible is None else visible
    return named(force, HINGE, *ends, smallest, visible)["force"]


def planted(name: str, *theta: float) -> Planted:
    """An effect with its parameters."""
    return Planted(effects()[name], J, np.array(theta))


def test_no_interval_is_narrower_than_machines_follow_the_law() -> None:
    strength, share = (
        least_spread((planted("joint.friction_coulomb", 10.0),), np.array([1e-3])),
        THRESHOLDS.law_strength * 10.0,
    )
    assert share < strength[0] < 1.01 * share
    gain = least_spread(
        (planted("actuator.gain", 0.5),), np.array([1e-3])
    )  # a factor is measured from one
    assert gain == 1e-3  # a factor is measured from one


def test_laws_that_stand_for_another_are_known_less_well() -> None:
    both = (
        planted("body.payload_moving", 2.0, 0.1, 0.0, 0.0, 0.0),
        planted("contact.obstacle", 0.5, 0.0, 0.0, 0.0, 0.6, 0.8, 1.0),
    )
    found = least_spread(both, np.concatenate([p.effect.steps() for p in both]))
    mass, travel = effects()["body.payload_moving"].parameters[:2]
    assert mass.inexact is not None and travel.inexact is not None
    np.testing.assert_allclose(found[:2], [2.0 * mass.inexact, 0.1 * travel.inexact], rtol=1e-3)
    normal = effects()["contact.obstacle"].parameters[1]
    assert normal.inexact is not None  # of all components: they are one direction
    np.testing.assert_allclose(found[8:11], normal.inexact, rtol=1e-3)


def test_a_vector_is_unknown_as_a_whole_and_not_for_one_component_that_may_be_nothing() -> None:
    force = Planted(effects()["body.force"], J, np.array([4.8, 2.0, -0.3]))
    wide = np.array([0.4, 0.6, 2.6])
    assert not of_force(force, wide).warning
    assert of_force(force, 3.0 * wide).warning


def test_what_joints_cannot_show_is_open_and_no_reason_to_doubt_the_rest() -> None:
    force = Planted(effects()["body.force"], J, np.array([4.8, 0.0, -0.3]))
    half = np.array([0.4, 0.0, 0.3])
    found = of_force(force, half, np.diag([1.0, 0.0, 1.0]))
    assert found.unshown == ("y",)
    assert not found.warning
    (low, high), bounds = found.ci95, force.effect.bounds()
    np.testing.assert_allclose(low, (4.4, bounds[0][1], -0.6))
    np.testing.assert_allclose(high, (5.2, bounds[1][1], 0.0))
    assert "cannot show y" in found.to_json()["warning"]


def test_what_makes_no_difference_beyond_some_size_has_no_upper_end(tmp_path: Path) -> None:
    """Friction that creeps and never slips might be any size from the one at which it would."""
    rubbing = chain(2).replace('name="j2"', 'name="j2" frictionloss="3"')
    slow = world(tmp_path, 2, None, 4.0, machine=rubbing)
    (creeping,) = effects()["joint.friction_coulomb"].forms
    at, ends = Location("joint", "j2"), {}
    for start in (0.3, 3.0):
        found = estimate(slow.objective, (Planted(creeping, at, np.array([start])),))
        ends[start] = found.estimates[0]["coulomb"].ci95
        assert "not identifiable" in found.estimates[0]["coulomb"].warning
    assert all(low < 3.0 for low, _ in ends.values())
    assert all(high == creeping.parameters[0].upper for _, high in ends.values())


@pytest.mark.parametrize("truth", [0.05, 0.3])
def test_what_makes_a_difference_has_both_ends(tmp_path: Path, truth: float) -> None:
    rubbing = chain(2).replace('name="j2"', f'name="j2" frictionloss="{truth}"')
    slow = world(tmp_path, 2, None, 4.0, machine=rubbing)
    (creeping,) = effects()["joint.friction_coulomb"].forms
    found = estimate(slow.objective, (Planted(creeping, Location("joint", "j2"), np.array([0.2])),))
    low, high = found.estimates[0]["coulomb"].ci95
    assert 0.5 * truth < low < truth < high < 2.0 * truth


def test_a_choice_has_no_interval() -> None:
    stop = planted("joint.stop", 0.8, -1.0)
    ends = stop.theta - np.array([0.1, 3.0]), stop.theta + np.array([0.1, 3.0])
    found = named(stop, HINGE, *ends, np.full(2, 0.01), np.eye(2))
    assert found["position"].ci95 == pytest.approx((0.7, 0.9))
    assert found["side"].ci95 == (-1.0, -1.0)
    assert not found["side"].warning


def test_where_motion_is_free_figures_are_as_good_as_noise_allows(tmp_path: Path) -> None:
    """A heavier link swings by hundreds of times the noise; much of that is forgiven any law."""
    free = re.sub(r'<position name="(a.)" joint="(j.)"[^>]*>', _MOTOR, chain(2))
    heavier = free.replace('mass="1.2"', f'mass="{1.2 * 1.6}"')
    path = tmp_path / "chain.xml"
    path.write_text(free)
    fit = smooth(Scene(path), [Part(record(heavier, None, 6.0, 0), 0)])
    some = Objective(fit, stretches_of(fit, False), STEP, False)
    assert some.floor[0] > 20.0 * some.noise[0]
    mass = Planted(effects()["body.mass"], Location("body", "link1"), np.array([1.4]))
    low, high = estimate(some, (mass,)).estimates[0]["factor"].ci95
    assert 1.35 < low < 1.6 < high < 1.85


def test_figures_are_told_apart_below_a_noise_that_is_taken_for_too_much(tmp_path: Path) -> None:
    replays = world(tmp_path, 1, on_joint(0, lambda q, v: -0.3 * v), 5.0).objective
    at, law = Location("joint", "j1"), effects()["joint.friction_viscous"]
    near: list[Hypothesis] = [(Planted(law, at, np.array([size])),) for size in (0.29, 0.28)]
    left = max(float(a.mse[0]) for a in replays.evaluate(near))
    channels = replace(replays.channels, floors=np.full((1, 1), 1.1 * np.sqrt(left)))
    forgiving = replays.judged(channels)
    assert len({a.loglik for a in forgiving.evaluate(near)}) == 1
    assert len({a.loglik for a in forgiving.sharper().evaluate(near)}) == 2


@pytest.mark.parametrize("times", [1.0, 0.25])
def test_of_what_shows_as_a_product_neither_factor_is_known(tmp_path: Path, times: float) -> None:
    """A point that circles a joint is pulled as much by half the spring, tied twice as far away."""
    stiffness, anchor = 40.0, np.array([0.3, 0.0, -0.2])

    def tied(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        pull = stiffness * (anchor - data.xpos[2])
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, data.xpos[2], 2)
        data.qfrc_applied[:] = jacobian.T @ pull

    slow = world(tmp_path, 2, tied, 4.0)
    start = np.array([times * stiffness, *(anchor / times)])
    tether = Planted(effects()["body.tether"], Location("body", "link2"), start)
    found = estimate(slow.objective, (tether,)).estimates[0]["stiffness"]
    low, high = found.ci95
    assert low < stiffness / 5.0 and high > 5.0 * stiffness
    assert "not identifiable" in found.warning
