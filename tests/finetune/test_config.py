"""What a configuration may say, and what it means."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.finetune.conftest import TINY, MakeModel
from wt.errors import ConfigError, ModelError
from wt.finetune.config import VARIANTS, Diagnosed, load
from wt.finetune.setting import Setting
from wt.finetune.training import environment
from wt.locomotion.env import make_model
from wt.worlds.legged import TIMESTEP, LeggedScene
from wt.worlds.robots import GO2

CONF = Path("conf") / "finetune_go2.yaml"


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("variants=[none,translatoin]", "did you mean 'translation'?"),
        ("variants=[]", "at least one"),
        ("seeds=[1,1]", "different values"),
        ("diagnosed.mjcf=null", "needs diagnosed.mjcf"),
        ("alignment=both", "alignment"),
        ("share=1.5", "share is 1.5; it must be at most 1, all of the robots"),
        ("workers=-1", "workers is -1; it must be zero or more"),
        ("share=0", "share is 0.0; it must be above zero"),
        ("modell=x", "did you mean 'model'?"),
        ("training.physics={}", "training.physics is not for the trainer"),
        ("randomization.friction=[0.0,1.0]", "randomization.friction"),
        ("randomization.gains=[1.2,0.8]", "randomization.gains"),
        ("randomization.gyro_noise=-1", "gyro_noise is -1"),
        ("evaluation.commands=[]", "evaluation.commands"),
        ("evaluation.commands=[[1,0,0]]", "evaluation.commands"),
        ("evaluation.episodes=0", "evaluation.episodes is 0"),
    ],
)
def test_a_mistake_is_named(word: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said.replace("[", r"\[")):
        load(CONF, [word])


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("training.ppo.iteratoins=3", "did you mean 'iterations'?"),
        ("task=conf/r5.yaml", "nothing walks there"),
        ("task=conf/none.yaml", "does not exist"),
    ],
)
def test_so_is_one_that_shows_with_the_task(word: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said.replace("?", r"\?")):
        Setting.of(load(CONF, [word])).training("translation", 0)


def test_a_policy_of_another_robot_is_refused() -> None:
    with pytest.raises(ModelError, match="robot differs from go2's"):
        Setting.of(load(CONF, ["policy=g1"]))


def test_training_is_in_s_and_goes_on_as_the_base_policy_was_trained(setting: Setting) -> None:
    training, card = setting.training("translation", 7), setting.base.card
    assert (training.seed, training.robots, training.ppo.iterations) == (7, 4, 2)
    assert training.rewards.impact == card.config["rewards"]["impact"] > 0
    assert training.rewards.tilt == 30.0 > card.config["rewards"]["tilt"]  # conf says so
    assert training.physics == setting.options.sim != setting.options.real
    assert training.name == "go2_payload_translation"
    s = setting.world().model("sim")
    np.testing.assert_array_equal(make_model(training).body_mass, s.body_mass)
    np.testing.assert_array_equal(make_model(training).actuator_gainprm, s.actuator_gainprm)
    shown = setting.shown()
    r = setting.world().model("real")
    np.testing.assert_array_equal(make_model(shown).body_mass, r.body_mass)


def test_the_shipped_file_asks_for_what_the_paper_did() -> None:
    config = load(CONF)
    assert config.variants == list(VARIANTS) and len(config.seeds) == 3
    setting = Setting.of(config)
    assert setting.options.concealed, "R has what S knows nothing of"
    assert setting.options.sim == setting.options.real, "and nothing else"
    assert setting.options.sim == Setting.of(load(CONF, ["task=go2_flat"])).options.sim  # light
    assert setting.training("translation", 0).ppo.iterations == 1000
    assert config.evaluation.episodes == 20
    assert config.randomization.base_mass == [-1.0, 3.0]


def diagnosed(
    path: Path, change: str = "", by: str = "", scene: LeggedScene | None = None
) -> Setting:
    """A setting whose S comes from a file: the task's own, changed as a diagnosis might."""
    setting = Setting.of(load(CONF, TINY))
    scene = scene or LeggedScene(setting.options.payload)
    spec = GO2.describe(setting.options.sim, TIMESTEP, scene)
    spec.compile()
    text = spec.to_xml()
    assert change in text
    path.write_text(text.replace(change, by) if change else text)
    config = replace(setting.config, diagnosed=Diagnosed(str(path), "x"))
    return replace(setting, config=config)


def test_a_diagnosed_simulator_takes_the_place_of_s(tmp_path: Path, make_model: MakeModel) -> None:
    stiff, soft = (f'gainprm="{gain}" biasprm="0 -{gain}' for gain in (50, 40))
    setting = diagnosed(tmp_path / "model.xml", stiff, soft)
    folder = make_model()
    for variant, gain in (("translation", 50), ("diagnosed", 40)):
        env = environment(setting, variant, folder)(setting.training(variant, 0), "cpu")
        assert env.herd.model.actuator("FL_calf_joint").gainprm[0] == gain
        assert env.herd.weight == pytest.approx(21.0 * 9.81, rel=0.01)  # robot, box and ball
        env.step(torch.zeros(4, 12))
    assert setting.base.card.stiffness[0] == 50  # the policy is the one that was trained for S


@pytest.mark.parametrize(
    ("change", "by", "said"),
    [
        ("<mujoco", "<mujocco", "is no MJCF"),
        ('"FL_hip_joint"', '"hip"', "has no joint 'FL_hip_joint'"),
        ('general name="FL_hip_joint"', 'general name="hip"', "has no actuator 'FL_hip_joint'"),
        ('name="stand"', 'name="lie"', "no keyframe 'stand'"),
    ],
)
def test_a_file_that_is_no_such_robot_is_refused(
    tmp_path: Path, change: str, by: str, said: str
) -> None:
    setting = diagnosed(tmp_path / "model.xml", change, by)
    with pytest.raises(ModelError, match=said):
        setting.world("diagnosed")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    setting = diagnosed(tmp_path / "model.xml")
    (tmp_path / "model.xml").unlink()
    with pytest.raises(ModelError, match="does not exist"):
        setting.world("diagnosed")
