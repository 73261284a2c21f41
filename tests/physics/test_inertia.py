"""Forces per inertial parameter against inverse dynamics of edited models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics.arm import ARM, Run, motion, scene, simulate
from wt.physics import inertia
from wt.physics.effect import effects
from wt.physics.motion import Motion
from wt.types import Location

Array = np.ndarray


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(ARM)


def changed(moved: Motion, body: str, effect: str, theta: Array) -> Array:
    """What the motion demands of a body whose ``inertial`` was edited, beyond its own."""
    spec = moved.scene.spec()
    effects()[effect].patch(spec, Location("body", body), theta)
    return moved.change(spec.compile())


@pytest.mark.parametrize(
    ("effect", "theta"),
    [("body.mass", [1.7]), ("body.com", [0.03, -0.02, 0.05]), ("body.inertia", [3.0])],
)
def test_demand_is_linear_in_the_inertial_parameters(
    effect: str, theta: list[float], run: Run, tmp_path: Path
) -> None:
    moved = motion(scene(tmp_path), run)
    for body in moved.scene.moving:
        m, c, i = inertia.own(moved.scene, body)
        if effect == "body.mass":
            other = inertia.parameters(theta[0] * m, c, theta[0] * i)
        elif effect == "body.com":
            other = inertia.parameters(m, c + np.array(theta), i)
        else:
            other = inertia.parameters(m, c, theta[0] * i)
        expected = changed(moved, body, effect, np.array(theta))
        found = inertia.demand(moved, body) @ (other - inertia.parameters(m, c, i))
        assert found == pytest.approx(expected, abs=1e-8 * np.abs(moved.demand).max())
        assert np.abs(expected).max() > 1e-6 * np.abs(moved.demand).max()
