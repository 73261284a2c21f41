"""Gains on held-out data."""

from __future__ import annotations

import numpy as np

from wt.diagnose.selection.holdout import gain_of, scaled

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
