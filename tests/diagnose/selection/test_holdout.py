"""Gains on held-out data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, on_joint, world
from wt.diagnose.likelihood.steps import Steps
from wt.diagnose.selection.holdout import errors, gain_of, gains, scaled
from wt.physics import rollout
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

NOISE = np.array([1e-3, 1e-3])
BLOCKS = np.repeat(np.arange(24), 25)


def errors_of(*sizes: tuple[float, float]) -> np.ndarray:
    """Errors (H, N, 2) of such root mean squares."""
    noise = np.random.default_rng(3).normal(size=(len(sizes), len(BLOCKS), 2))
    return noise / np.sqrt(np.mean(noise**2, axis=1, keepdims=True)) * np.array(sizes)[:, None]


def test_what_one_leaves_at_a_joint_counts_as_what_another_does() -> None:
    """The first leaves three times as much at one joint, and less by a little at the other."""
    first, second = errors_of((9e-3, 2e-3), (3e-3, 2.4e-3))
    there, back = (scaled(np.stack(p), NOISE) for p in ((first, second), (second, first)))
    np.testing.assert_allclose(there, back[::-1])
    np.testing.assert_allclose(np.sqrt(np.mean(there**2, axis=1)), [[3.0, 1.0], [1.0, 1.2]])
    assert gain_of(*there, (BLOCKS, BLOCKS)).p_value < 1e-3
    assert gain_of(*back, (BLOCKS, BLOCKS)).p_value == 1.0


def test_what_is_within_noise_is_measured_by_it() -> None:
    tiny = scaled(errors_of((1e-4, 2e-3), (2e-4, 2e-3)), NOISE)
    np.testing.assert_allclose(np.sqrt(np.mean(tiny**2, axis=1))[:, 0], [0.1, 0.2])


def test_effects_are_judged_by_what_coarse_replays_say_is_different(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the whole takes fine steps, and it errs by what it does with these."""
    rubbing = on_joint(0, lambda q, v: -0.6 * float(np.tanh(v / 0.01)))
    held = world(tmp_path, 2, rubbing, 4.0).held
    names = (("friction_coulomb", "j1", 0.6), ("friction_viscous", "j2", 0.02))
    dry, wet = (
        Planted(effects()[f"joint.{name}"], Location("joint", joint), np.array([size]))
        for name, joint, size in names
    )
    coarse = replace(held, steps=Steps(STEP, 4.0 * STEP))
    exact = gains(held, (dry, wet), [(wet,), (dry,)], STEP)
    asked: dict[float, int] = {}
    part = rollout.Replayer.part

    def counted(self: rollout.Replayer, hypotheses: list[object], *rest: object) -> np.ndarray:
        asked[self.step] = asked.get(self.step, 0) + len(hypotheses)
        return part(self, hypotheses, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(rollout.Replayer, "part", counted)
    (q, _) = coarse.side_by_side([(dry, wet), (wet,)], STEP)
    finest, plain = (errors(held, [(dry, wet)], h)[0] for h in (STEP / 8.0, STEP))
    off, plain_off = (np.nanstd(e - finest, axis=0) for e in (q - held.measured, plain))
    assert (off <= np.maximum(plain_off, 0.1 * held.smoothed.noise)).all()
    asked.clear()
    said = gains(coarse, (dry, wet), [(wet,), (dry,)], STEP)
    assert STEP not in asked  # remembered, and for no other
    assert [g.share for g in said] == pytest.approx([g.share for g in exact], rel=0.03)
    assert said[0].p_value < 1e-3
