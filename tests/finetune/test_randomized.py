"""Every robot of the rival has physics of its own, within the ranges, and noisy sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wt.finetune.config import Randomization
from wt.finetune.randomized import Randomized
from wt.finetune.setting import Setting
from wt.finetune.training import environment
from wt.locomotion.env import Walking
from wt.worlds.legged import Herd


def test_physics_are_drawn_within_their_ranges(setting: Setting) -> None:
    training = setting.training("randomization", 0)
    ranges = Randomization()
    nominal = Walking(training, "cpu").herd.model
    models = Randomized(training, "cpu", ranges).herd.batch.models
    trunk, gain = nominal.body("base").id, nominal.actuator("FL_hip_joint").id
    foot = nominal.geom("FL_foot").id
    added = [float(m.body_mass[trunk] - nominal.body_mass[trunk]) for m in models]
    usual = nominal.actuator_gainprm[gain, 0]
    factors = [float(m.actuator_gainprm[gain, 0] / usual) for m in models]
    friction = [float(m.geom_friction[foot, 0]) for m in models]
    for values, (low, high) in (
        (added, ranges.base_mass), (factors, ranges.gains), (friction, ranges.friction),
    ):  # fmt: skip
        assert len(set(values)) == 4
        assert low <= min(values) < max(values) <= high
    again = Randomized(training, "cpu", ranges).herd.batch.models
    assert [m.body_mass[trunk] for m in again] == [m.body_mass[trunk] for m in models]


def test_robots_move_by_their_own_physics(setting: Setting) -> None:
    training = setting.training("randomization", 0)
    heavy = Randomization(base_mass=[3.0, 3.0], gains=[1.0, 1.0], friction=[0.6, 0.6])
    same = Randomization(base_mass=[0.0, 0.0], gains=[1.0, 1.0], friction=[0.6, 0.6])
    raw, laden, plain = (
        Walking(training, "cpu"),
        *(Randomized(training, "cpu", r) for r in (heavy, same)),
    )
    for env in (raw, laden, plain):
        for _ in range(25):
            env.herd.step(np.zeros((4, 12)))
    np.testing.assert_allclose(plain.herd.qpos, raw.herd.qpos, atol=1e-9)
    assert (laden.herd.qpos[:, 2] < raw.herd.qpos[:, 2] - 1e-3).all()


def test_its_physics_step_is_the_task_s(setting: Setting) -> None:
    finer = replace(setting, options=replace(setting.options, timestep=0.002))
    training = finer.training("randomization", 0)
    herd = environment(finer, "randomization", None)(training, "cpu").herd
    assert isinstance(herd, Herd)
    assert {m.opt.timestep for m in herd.batch.models} == {herd.model.opt.timestep} == {0.002}


def test_noise_is_on_what_the_actor_sees_alone(setting: Setting) -> None:
    env = environment(setting, "randomization", None)(setting.training("randomization", 0), "cpu")
    error = np.abs(env.get_observations()["policy"][:, :42].numpy() - env.herd.observe())
    widths = np.repeat([0.2, 0.05, 0.01, 1.5, 0.0], [3, 3, 12, 12, 12])
    assert (error <= widths + 1e-6).all()
    assert (error[:, :30].max(axis=0) > 0).all()
