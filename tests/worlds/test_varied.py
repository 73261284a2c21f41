"""Simulators around S: what is another in each, what is not, and what is collected from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.worlds.walking.test_world import world
from wt.config import DataConfig
from wt.worlds.collect import collect
from wt.worlds.varied import AROUND_S, FACTORS, Varied, Widths, drawn, lessons_spec, varied


def near(seed: int, widths: Widths = AROUND_S) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    walking = world("go2_payload")
    (factors,) = drawn(np.random.default_rng(seed), 1, widths)
    sim = walking.model("sim")
    return sim, varied(sim, "base", walking.spec.joints, factors)


def test_drives_friction_and_masses_are_others_within_their_widths() -> None:
    sim, other = near(1)
    for name, width in (
        ("actuator_gainprm", AROUND_S.drives), ("dof_damping", AROUND_S.friction),
        ("dof_frictionloss", AROUND_S.friction), ("body_mass", AROUND_S.trunk),
    ):  # fmt: skip
        of_sim, of_other = getattr(sim, name), getattr(other, name)
        moved = of_sim != of_other
        assert moved.any()
        assert np.all(np.abs(np.log(of_other[moved] / of_sim[moved])) <= width + 1e-9)
    # a position drive stays one: force = k (u − q) − kᵥ q̇
    np.testing.assert_allclose(other.actuator_biasprm[:, 1], -other.actuator_gainprm[:, 0])


@pytest.mark.parametrize(
    ("factor", "value"), list(enumerate([0.1, -0.2, 0.9, -1.1, 0.12, -0.08, 0.2]))
)
def test_a_factor_is_one_of_what_it_is_named_after(factor: int, value: float) -> None:
    walking = world("go2_payload")
    sim, joints = walking.model("sim"), walking.spec.joints
    other = varied(sim, "base", joints, value * np.eye(len(FACTORS))[factor])
    leg, drive = sim.joint(joints[0]), sim.actuator(joints[0]).id
    foot = int(np.flatnonzero(sim.geom_bodyid == leg.bodyid[0])[0])
    ratios = {
        "stiffness": other.actuator_gainprm[drive, 0] / sim.actuator_gainprm[drive, 0],
        "velocity_gain": other.actuator_biasprm[drive, 2] / sim.actuator_biasprm[drive, 2],
        "damping": other.dof_damping[leg.dofadr[0]] / sim.dof_damping[leg.dofadr[0]],
        "frictionloss": other.dof_frictionloss[leg.dofadr[0]] / sim.dof_frictionloss[leg.dofadr[0]],
        "trunk_mass_scale": other.body("base").mass[0] / sim.body("base").mass[0],
        "limb_mass_scale": other.body_mass[leg.bodyid[0]] / sim.body_mass[leg.bodyid[0]],
        "floor_friction": other.geom_friction[foot, 0] / sim.geom_friction[foot, 0],
    }
    names = [channel.name.removeprefix("log_factor/") for channel in FACTORS]
    assert list(ratios) == names
    expected = np.where(np.arange(len(names)) == factor, np.exp(value), 1.0)
    np.testing.assert_allclose(list(ratios.values()), expected)


def test_s_and_its_load_stay_as_they_are() -> None:
    before, other = near(1)
    sim = world("go2_payload").model("sim")
    np.testing.assert_array_equal(before.body_mass, sim.body_mass)
    for body in ("box", "ball"):
        assert other.body(body).mass == sim.body(body).mass
    assert other.body("world").subtreemass == pytest.approx(other.body_mass.sum())


def test_without_width_it_is_s() -> None:
    sim, same = near(1, Widths(0.0, 0.0, 0.0, 0.0, 0.0))
    for name in ("actuator_gainprm", "actuator_biasprm", "dof_damping", "body_mass"):
        np.testing.assert_array_equal(getattr(same, name), getattr(sim, name))


def test_each_robot_of_lessons_has_physics_of_its_own() -> None:
    walking = world("go2_flat")
    lessons, sim = walking.lessons(200, 5), walking.collect("sim", 200, 5)
    np.testing.assert_array_equal(lessons.o[lessons.step == 0], sim.o[sim.step == 0])
    first = lessons.step == 0  # from the same state under the same action
    apart = np.abs(lessons.s_next[first] - sim.s_next[first]).max(axis=1)
    assert np.all(apart > 1e-5)
    assert np.all(np.isfinite(lessons.hidden))
    # behind what is hidden stand the factors, the same all along a robot's walk
    assert len(lessons_spec(walking.spec).hidden) == lessons.hidden.shape[1]
    factors = lessons.hidden[:, len(walking.spec.hidden) :]
    robots = np.cumsum(first & np.append(True, np.diff(lessons.episode) != 0)) - 1
    for robot in np.unique(robots):
        assert len(np.unique(factors[robots == robot], axis=0)) == 1
    assert len(np.unique(factors, axis=0)) == len(np.unique(robots))
    again = walking.lessons(200, 5)
    np.testing.assert_array_equal(again.s_next, lessons.s_next)


def test_lessons_are_collected_where_they_are_asked_for(tmp_path: Path) -> None:
    walking = world("go2_flat")
    settings = DataConfig(str(tmp_path), 100, 50, 50, 3)
    assert collect(walking, settings, validation=False).lessons is None
    assert isinstance(walking, Varied)
    few = collect(walking, replace(settings, lessons=60), validation=False, lessons=True)
    assert few.lessons is not None
    assert len(few.lessons) == 60
    asked = collect(walking, settings, validation=False, lessons=True)
    assert asked.lessons is not None
    assert len(asked.lessons) == 100
    none = collect(walking, replace(settings, lessons=0), validation=False, lessons=True)
    assert none.lessons is None
