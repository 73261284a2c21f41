"""What a recording shows is found at the same place, and as large, however the file is written."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.test_ways import JOINTS, place
from tests.physics.ways import PLAIN, written
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.residual.screen import Screen
from wt.physics.effect import effects
from wt.physics.scene import Scene
from wt.types import Location, Recording

NAMED = {
    "joint.friction_coulomb": (Location("joint", "j0"), 'damping="0.05 0" frictionloss="0.4"'),
    "joint.friction_viscous": (Location("joint", "j0"), 'damping="0.5 0" frictionloss="0.02"'),
}
"""What is changed of the first joint in the file, and where it is to be found."""
AGREED = 1e-3
"""Share by which estimates may differ: each way's file says the same to nine digits and more."""


def recorded(joint: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], commands and positions, (300,) and (300, 3), of a machine high above its floor."""
    model = mujoco.MjSpec.from_string(
        PLAIN.replace('damping="0.05 0" frictionloss="0.02"', joint, 1)
    )
    model.option.timestep = 5e-4
    model.geom("floor").pos[2] = -9.0
    compiled = model.compile()
    data, t, rng = mujoco.MjData(compiled), 0.01 * np.arange(300), np.random.default_rng(0)
    waves = [0.6 * np.sin(4.1 * t), 0.3 * np.sin(3.3 * t) - 0.4, 0.3 * np.sin(5.7 * t) - 0.3]
    u, q = np.stack(waves, axis=1), np.empty((300, 3))
    for k in range(300):
        data.ctrl[:], q[k] = u[k], data.qpos
        mujoco.mj_step(compiled, data, 20)
    return t, u, q + 1e-4 * rng.standard_normal(q.shape)


@pytest.mark.parametrize(
    ("effect", "among"),
    [
        ("joint.friction_coulomb", {"joint"}),
        pytest.param(
            "joint.friction_viscous", {"joint", "actuator", "body"}, marks=pytest.mark.long
        ),
    ],
)
def test_the_first_to_be_found_is_the_same_one(
    effect: str, among: set[str], tmp_path: Path
) -> None:
    at, joint = NAMED[effect]
    (t, u, q), expected = recorded(joint), None
    for way, path in written(tmp_path).items():
        names = [place(Location("actuator", f"m{i}"), way).name for i in range(3)]
        columns = {f"ctrl/{name}": u[:, i] for i, name in enumerate(names)}
        for i, name in enumerate(JOINTS):
            columns[f"qpos/{place(Location('joint', name), way).name}"] = q[:, i]
        parts = [Part(Recording(t, columns, {"robot": "arm"}), 0)]
        scene = Scene(path)
        every = ((e, p) for e in effects().values() for p in e.places(scene))
        only = {(e.id, p) for e, p in every if p.kind in among}
        first = Screen(smooth(scene, parts)).rank([], only)[0].planted
        assert (first.effect.id, first.at) == (effect, place(at, way)), way
        expected = first.theta if expected is None else expected
        np.testing.assert_allclose(first.theta, expected, rtol=AGREED, err_msg=way)
