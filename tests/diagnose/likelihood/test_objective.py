"""What may adapt beside a hypothesis: what any rig is off by, and how each stretch began."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.diagnose.hidden_forces import NOISE, RATE, STEP, chain, record
from wt.diagnose.likelihood import objective as likelihood
from wt.diagnose.likelihood.bic import erring_joints, exhausted
from wt.diagnose.likelihood.objective import Assessed, Objective
from wt.diagnose.likelihood.tolerances import taken_over, tolerances
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.diagnose.thresholds import THRESHOLDS
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording


def smoothed(folder: Path, made_by: str, believed: str, seconds: float = 6.0) -> Smoothed:
    path = folder / "chain.xml"
    path.write_text(believed)
    return smooth(Scene(path), [Part(record(made_by, None, seconds, 0), 0)])


def objective(fit: Smoothed, forgets: bool) -> Objective:
    stretches = stretches_of(fit, forgets)
    return Objective(fit, stretches, STEP, forgets)


@pytest.mark.parametrize("forgets", [True, False])
def test_a_rig_that_is_off_by_much_leaves_nothing_but_noise(tmp_path: Path, forgets: bool) -> None:
    """4 % of a mass move a replay by hundreds of times the noise: one linear step is too few."""
    made_by = chain(2).replace('mass="1.2"', f'mass="{1.2 * 1.04}"')
    made_by = made_by.replace('mass="1.05"', f'mass="{1.05 * 0.96}"')
    some = objective(smoothed(tmp_path, made_by, chain(2)), forgets)
    now = some.reference(())
    assert not erring_joints(some, now)
    (raw,) = some._raw([()])
    assert np.abs(raw).max() > 30 * NOISE
    found = {
        n.planted.at.name: x
        for n, x in zip(some.tolerances, now.tolerances, strict=True)
        if n.planted.effect.id == "body.mass"
    }
    assert found["link1"] > 1.0
    assert found["link2"] < -1.0


def test_where_nothing_but_noise_is_left_nothing_can_be_gained(tmp_path: Path) -> None:
    same = objective(smoothed(tmp_path, chain(2), chain(2)), True)
    assert exhausted(same, same.reference(()))
    rubbing = chain(2).replace('damping=".3"', 'damping=".3" frictionloss=".2"')
    other = objective(smoothed(tmp_path, rubbing, chain(2)), True)
    assert not exhausted(other, other.reference(()))


def starts(path: Path, made: Recording) -> np.ndarray:
    """When stretches begin [s]."""
    return np.array([s.t[0] for s, _ in stretches_of(smooth(Scene(path), [Part(made, 0)]), False)])


def test_no_stretch_begins_in_a_jolt(tmp_path: Path) -> None:
    """Another hand shoves the joint where a stretch would begin."""
    path = tmp_path / "chain.xml"
    path.write_text(chain(1))
    made = record(chain(1), None, 4.0, 0)
    calm = starts(path, made)
    since = made.t - calm[3]
    shoved = made.columns["qpos/j1"] + np.where(since >= 0.0, 0.05 * np.exp(-20.0 * since), 0.0)
    columns = {"qpos/j1": shoved, "ctrl/a1": made.columns["ctrl/a1"]}
    found = starts(path, Recording(made.t, columns))
    others = np.arange(len(calm)) != 3
    others[0] = False  # as late as its curve's first knots, which are others
    np.testing.assert_array_equal(found[others], calm[others])
    assert calm[3] + 3 / RATE < found[3] < calm[3] + 0.25


def test_tolerances_go_no_farther_than_replays_get_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is linear promises more than a replay keeps where all that way is tolerances."""
    made_by = chain(2).replace('mass="1.2"', f'mass="{1.2 * 1.3}"')
    some = objective(smoothed(tmp_path, made_by, chain(2)), True)
    raw, rig, far = some._raw, some._nearby.rig, {}

    def noted(sizes: np.ndarray) -> tuple[Planted, ...]:
        planted = rig(sizes)
        far[planted] = float(np.abs(sizes).max()) > 2.0
        return planted

    def worse(hypotheses: list[tuple[Planted, ...]]) -> np.ndarray:
        factors = [9.0 if far.get(h, False) else 1.0 for h in hypotheses]
        return raw(hypotheses) * np.array(factors)[:, None, None]

    monkeypatch.setattr(some._nearby, "rig", noted)
    monkeypatch.setattr(some, "_raw", worse)
    assert 0.0 < np.abs(some.reference(()).centre).max() <= 2.0


def test_an_effect_as_small_as_a_tolerance_is_one(tmp_path: Path) -> None:
    path = tmp_path / "chain.xml"
    path.write_text(chain(2))
    scene = Scene(path)
    errors = tolerances(scene)
    found = next(t for t in errors if t.planted.effect.id == "actuator.gain")
    zero, at = np.zeros(len(errors)), errors.index(found)
    off = float(found.planted.theta[0]) - found.neutral

    def weak(deviations: float) -> Planted:
        theta = np.array([found.neutral + deviations * off])
        return Planted(found.effect, found.at, theta)

    assert taken_over(errors, zero, weak(-0.4))[at] == pytest.approx(-0.4)
    assert taken_over(errors, zero, weak(-40.0))[at] == -THRESHOLDS.tolerance_box
    other = Planted(effects()["joint.stop"], Location("joint", "j1"), np.array([0.3, 1.0]))
    assert not taken_over(errors, zero, other).any()


def test_linearised_again_as_long_as_replays_get_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a rig whose drives are torques is off by takes more than a few steps to find."""
    some = objective(smoothed(tmp_path, chain(2), chain(2)), True)
    linearised, times, met = some._linearised, [0], list[float]()

    def counted(hypothesis: tuple[Planted, ...], anew: bool) -> Assessed:
        times[0] += 1
        return linearised(hypothesis, anew)

    def better(error: np.ndarray, centre: np.ndarray) -> float:
        gains = [4.0, 3.0, 2.0, 0.0] if times[0] < 9 else [0.0] * 4
        met.append(gains[len(met) % 4])
        return met[-1]

    monkeypatch.setattr(some, "noise", np.zeros(2))
    monkeypatch.setattr(likelihood, "_LEFT", 0.0)
    monkeypatch.setattr(some, "_linearised", counted)
    monkeypatch.setattr(some, "_met", better)
    some.reference(())
    assert times[0] == 9


def test_what_tolerances_change_is_taken_over_from_close_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rubbing = chain(2).replace('damping=".3"', 'damping=".3" frictionloss=".2"')
    fit = smoothed(tmp_path, rubbing, chain(2))
    some, other = objective(fit, True), objective(fit, True)
    near: list[int] = []
    around = some._nearby._replays.around

    def counted(
        reference: tuple[Planted, ...], moved: list[tuple[Planted, ...]]
    ) -> tuple[np.ndarray, np.ndarray]:
        near.append(len(moved))
        return around(reference, moved)

    monkeypatch.setattr(some._nearby._replays, "around", counted)

    def dry(*torques: float) -> tuple[Planted, ...]:
        effect = effects()["joint.friction_coulomb"]
        return tuple(
            Planted(effect, Location("joint", f"j{i}"), np.array([torque]))
            for i, torque in enumerate(torques, 1)
        )

    some.reference(dry(0.17, 0.2))
    assert max(near) == len(some.tolerances)
    near.clear()
    taken, own = some.reference(dry(0.2, 0.21)), other.reference(dry(0.2, 0.21))
    assert near == [0]
    assert abs(taken.loglik - own.loglik) < 0.5
    left, apart = other.left(own), some.left(taken) - other.left(own)
    assert ((apart**2).mean(axis=0) < 0.1 * (left**2).mean(axis=0)).all()
    # of other parameters, or of another law, it says nothing
    near.clear()
    some.reference(dry(0.5, 0.2))
    assert near[0] == len(some.tolerances)
    near.clear()
    viscous = Planted(effects()["joint.friction_viscous"], Location("joint", "j1"), np.array([0.5]))
    some.reference((viscous, *dry(0.5, 0.2)[1:]))
    assert near[0] == len(some.tolerances)


def test_what_tolerances_change_is_taken_over_from_one_effect_less(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rubbing = chain(2).replace('damping=".3"', 'damping=".3" frictionloss=".2"')
    fit = smoothed(tmp_path, rubbing, chain(2))
    some, other = objective(fit, True), objective(fit, True)
    both = tuple(
        Planted(effects()["joint.friction_coulomb"], Location("joint", joint), np.array([0.2]))
        for joint in ("j1", "j2")
    )
    some.reference(both[:1])
    linearised = Mock(wraps=some._nearby._replays.around)
    monkeypatch.setattr(some._nearby._replays, "around", linearised)
    taken, own = some.reference(both), other.reference(both)
    assert not linearised.call_args_list[0].args[1]
    assert abs(taken.loglik - own.loglik) < 1.0


@pytest.mark.parametrize("alike", [True, False])
def test_what_tolerances_change_is_lent_to_another_law_where_a_replay_says_that_it_will_do(
    alike: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rubbing = chain(2).replace('damping=".3"', 'damping=".3" frictionloss=".2"')
    fit = smoothed(tmp_path, rubbing, chain(2))
    some, other = objective(fit, True), objective(fit, True)

    def law(name: str, joint: str, size: float) -> Planted:
        return Planted(effects()[f"joint.{name}"], Location("joint", joint), np.array([size]))

    dry = law("friction_coulomb", "j1", 0.2)
    known = (dry, law("friction_coulomb", "j2", 0.2))
    now = (dry, law("friction_viscous", "j2", 0.3))
    some.reference(known)
    linearised = Mock(wraps=some._nearby._replays.around)
    monkeypatch.setattr(some._nearby._replays, "around", linearised)
    if not alike:
        monkeypatch.setattr(likelihood, "_LINEAR", 0.0)
    taken = some.reference(now, most=1, beside=known)
    replayed = [len(call.args[1]) for call in linearised.call_args_list]
    assert replayed == [0] + [len(some.tolerances)] * (not alike)
    if alike:
        assert abs(taken.loglik - other.reference(now, most=1).loglik) < 2.0
    else:
        assert taken.loglik == other.reference(now, taken.centre, most=1).loglik
    # nor where it is known itself, or nothing is of the other
    for hypothesis, lender in ((now, known), ((dry, law("armature", "j2", 0.1)), (now[1],))):
        assert not some._nearby.lent(hypothesis, lender)
