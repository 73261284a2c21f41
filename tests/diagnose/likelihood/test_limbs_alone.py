"""What a step moves at one limb costs no replay of another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, record
from wt.diagnose.likelihood.objective import Objective
from wt.diagnose.likelihood.refine import refine
from wt.diagnose.likelihood.tolerances import rounded
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location


def pair(heavier: float = 1.0, dry: float = 0.0) -> str:
    """Two links that hang beside each other, j1 and j2."""
    links = "".join(
        f'<body name="link{k}" pos="0 {k} 0"><joint name="j{k}" axis="0 1 0" damping=".3" '
        f'frictionloss="{dry if k == 1 else 0.0}"/><geom type="capsule" '
        f'fromto="0 0 0 .03 .02 -.25" size=".03" mass="{heavier}"/></body>'
        for k in (1, 2)
    )
    servos = "".join(f'<position name="a{k}" joint="j{k}" kp="60" kv="3"/>' for k in (1, 2))
    return (
        '<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>'
        f"<worldbody>{links}</worldbody><actuator>{servos}</actuator></mujoco>"
    )


def test_the_other_limb_is_replayed_once_for_many_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pair.xml"
    path.write_text(pair())
    fit = smooth(Scene(path), [Part(record(pair(1.02, 0.2), None, 6.0, 0), 0)])
    some = Objective(fit, stretches_of(fit, True), STEP, True)
    some.reference(())
    replayed: list[str] = []
    part = Replayer.part

    def counted(self: Replayer, hypotheses: Sequence[object], *more: object) -> np.ndarray:
        replayed.extend(["+".join(self.scene.joints)] * len(hypotheses))
        return part(self, hypotheses, *more)  # type: ignore[arg-type]

    monkeypatch.setattr(Replayer, "part", counted)
    starts = [
        (Planted(effects()[f"joint.{law}"], Location("joint", "j1"), np.array([size])),)
        for law, size in (("friction_coulomb", 0.1), ("friction_viscous", 0.2), ("armature", 0.02))
    ]
    fits = refine(some, starts, [[0]] * len(starts), iterations=2)
    assert max(fits, key=lambda f: f.loglik) is fits[0]
    assert replayed.count("j1") > 9
    assert replayed.count("j2") < 4


def test_inside_the_boxes() -> None:
    sizes, box = np.array([1.0 / 3.0, -2.0, 0.0]), np.array([1.0, np.pi / 2.0, 0.0])
    np.testing.assert_array_equal(rounded(sizes, box), [0.33333, -np.pi / 2.0, 0.0])
