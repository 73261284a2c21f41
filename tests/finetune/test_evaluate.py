"""The three figures, on signals whose figures are known, and on a robot that only stands."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt.finetune.evaluate import Downstream, commands, evaluate, figures, pitch_and_roll
from wt.finetune.results import plain, table
from wt.finetune.setting import Setting


def test_figures_of_sines() -> None:
    t = np.linspace(0, 2 * np.pi, 1001)[:-1, None]
    tilt = np.stack([0.3 + 0.1 * np.sin(t), -0.2 + 0.05 * np.cos(t)], axis=-1)
    up = np.ones_like(t, bool)
    tracking, stability, power, walking = figures(
        0.2 * np.sin(t), tilt, 10 + np.sin(t), np.abs(np.cos(t)), up
    )
    assert tracking == pytest.approx(0.2 / np.sqrt(2))
    assert stability == pytest.approx(np.sqrt((0.1**2 + 0.05**2) / 2))  # of sines: A/√2
    assert power == pytest.approx(10)
    assert walking == pytest.approx(1 / np.sqrt(2))


def test_what_comes_after_a_fall_does_not_count() -> None:
    error, up = np.full((10, 2), 0.1), np.ones((10, 2), bool)
    error[5:, 1], up[5:, 1] = 9.0, False
    tracking, *_ = figures(error, np.zeros((10, 2, 2)), error, error, up)
    assert tracking == pytest.approx(0.1)


def test_pitch_and_roll_are_those_of_the_rotation() -> None:
    pitch, roll = 0.2, -0.3
    turn = Rotation.from_euler("ZYX", [1.0, pitch, roll]).as_matrix()
    np.testing.assert_allclose(pitch_and_roll((turn.T @ [0, 0, -1])[None]), [[pitch, roll]])


def test_commands_are_held() -> None:
    told = commands([[0.04, 0.5, 0.0, 0.0], [0.06, 0.0, 0.0, -1.0]], 0.02)
    np.testing.assert_array_equal(told, [[0.5, 0, 0]] * 2 + [[0, 0, -1]] * 3)


def test_who_stands_does_not_turn(setting: Setting) -> None:
    """Error as large as the command, little tilt or power; the physics are R's."""
    herd = setting.reality(3)
    assert herd.model.joint(herd.model.njnt - 1).name == "ball"
    assert herd.model.actuator(0).gainprm[0] == setting.options.real.stiffness[0] == 40

    class Stands(type(setting.base)):
        def act(self, *_: object) -> np.ndarray:
            return np.zeros((3, 12), np.float32)

    policy = Stands(setting.base.card, setting.base._graph)
    found = evaluate(herd, policy, [[5.0, 0.0, 0.0, 0.8]], seed=0)
    assert found.tracking == pytest.approx(0.8, rel=0.1)
    assert found.power < 5 and found.stability < 0.1 and found.fallen == 0


def test_the_table_has_the_paper_s_figures_beside_ours() -> None:
    found = {
        "none": {0: Downstream(0.2, 0.05, 10.0, 0.1, 0.0)},
        "translation": {
            0: Downstream(0.1, 0.05, 11.0, 0.2, 0.0),
            1: Downstream(0.12, 0.05, 11.0, 0.2, 0.5),
        },
        "diagnosed": {0: Downstream(0.09, 0.05, 10.0, 0.1, 0.0)},
    }
    results = plain(found, {"task": "toy"})
    text = table(results)
    assert "| none | 0.2 | 0.2475 | 0.05 | 0.0517 | 10 | 28.07 | 0.1 | 0% |" in text
    assert "| translation | 0.11 ± 0.01 | 0.1786 |" in text and "| 0.2 ± 0 | 25% |" in text
    assert "| diagnosed | 0.09 | – |" in text
    assert "translation against none: tracking -45.0% (aim: -30% at most)" in text
    assert results["to_none"]["translation"]["power"] == pytest.approx(1.1)


def test_the_table_says_how_many_updates_a_training_that_was_cut_short_has_had() -> None:
    found = {v: {0: Downstream(0.2, 0.05, 10.0, 0.1, 0.0)} for v in ("none", "stance")}
    found["stance"][1] = found["stance"][0]
    updates = {"none": {0: 0}, "stance": {0: 7, 1: 10}}
    results = plain(found, {"iterations": 10}, updates)
    assert results["variants"]["stance"]["updates"] == [7, 10]
    head, _, none, stance, *_ = table(results).splitlines()
    assert head.endswith("| fell | updates |")
    assert none.endswith("| 0% | 0 |") and stance.endswith("| 0% | 7 to 10 |")
    whole = plain(found, {"iterations": 7}, {**updates, "stance": {0: 7, 1: 7}})
    assert "updates" not in table(whole)
