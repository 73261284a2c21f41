"""What models are usually off by is taken out of a residual, and what happens once is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import ARM, scene
from wt.physics import inertia
from wt.physics.motion import Motion, Segment
from wt.physics.scene import Scene
from wt.physics.usual import smoothed, unusual

DT, SECONDS = 0.005, 12.0
T = DT * np.arange(round(SECONDS / DT))


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    return scene(tmp_path, ARM)


def moved(arm: Scene) -> Motion:
    """Two sines in each joint."""
    rates = np.array([[2.0, 5.3], [2.7, 6.1], [3.3, 7.9]]).T
    phase = rates * T[:, None, None]
    q = np.sin(phase).sum(axis=1)
    v = (rates * np.cos(phase)).sum(axis=1)
    a = (-(rates**2) * np.sin(phase)).sum(axis=1)
    command = np.zeros((len(T), arm.model.nu))
    return Motion(arm, (Segment(slice(0, len(T)), 0, DT),), T, q, v, a, command)


def residual(motion: Motion, force: np.ndarray) -> Motion:
    return motion.without(motion.residual - force)


def test_a_heavier_link_and_friction_leave_nothing_but_the_push(arm: Scene) -> None:
    motion = moved(arm)
    body = arm.moving[-1]
    own = inertia.parameters(*inertia.own(arm, body))
    errors = -0.04 * inertia.demand(motion, body) @ own - 0.5 * np.tanh(motion.v / 0.1)
    push = np.zeros_like(motion.q)
    push[:, 1] = 0.8 * np.exp(-0.5 * ((T - 6.0) / 0.08) ** 2)
    left = unusual(residual(motion, errors + push))
    assert np.abs(smoothed(motion, left.force - push)).max() < 0.02
    assert np.abs(smoothed(motion, errors)).max() > 0.5
    assert (left.deviation < 0.01).all()
    assert left.dry == pytest.approx(np.full(3, 0.5), abs=0.1)


def test_friction_may_hold_a_joint_that_stands(arm: Scene) -> None:
    motion = moved(arm)
    still = np.abs(T - 6.0) < 1.0
    motion.v[still, 2] = 0.0
    left = unusual(residual(motion, -0.5 * np.tanh(motion.v / 0.1)))
    assert left.still[np.abs(T - 6.0) < 0.5, 2].min() > 0.99
    assert left.still[np.abs(T - 6.0) > 2.0, 2].mean() < 0.2
