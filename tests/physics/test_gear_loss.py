"""A gear that loses more while it is driven than while it drives, and what it is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import Run, motion, scene, simulate
from tests.physics.laws import directed, load, lossy, push, stribeck
from tests.physics.truths import ARM
from wt.physics.effect import effects
from wt.physics.effects._bristle import slip
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.types import Location

AT, DRIVE = Location("joint", "j1"), Location("actuator", "m1")
GEAR = effects()["joint.gear_loss"]
LOSSES = np.array([0.1, 0.35, 0.3, 0.2])
BOUNDS = {p.name: (p.lower, p.upper) for p in GEAR.parameters}


def law(name: str, *theta: float) -> Planted:
    effect = effects()[name]
    return Planted(effect, DRIVE if effect.kind == "actuator" else AT, np.array(theta))


def replayed(folder: Path, run: Run, *hypotheses: tuple[Planted, ...]) -> np.ndarray:
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    return Replayer(scene(folder), [stretch]).run(hypotheses).q


def test_a_loss_of_one_size_is_friction_by_load(tmp_path: Path) -> None:
    gear, two, none = replayed(
        tmp_path,
        simulate(ARM),
        (law("joint.gear_loss", 0.2, 0.2, 0.3, 0.0),),
        (law("joint.friction_load", 0.3, 0.2),),
        (),
    )
    np.testing.assert_allclose(gear, two, atol=1e-6)
    assert np.abs(gear - none).max() > 0.01


def test_as_it_slides_it_is_friction_by_load_beside_a_stronger_drive(tmp_path: Path) -> None:
    two = (
        law("joint.friction_load", 0.3, 0.225),
        law("actuator.gain", 1.125),
        law("joint.friction_viscous", 0.2),
    )
    gear, parts, none = replayed(
        tmp_path, simulate(ARM), (law("joint.gear_loss", *LOSSES),), two, ()
    )
    assert np.sqrt(np.mean((gear - parts) ** 2)) < 0.03 * np.sqrt(np.mean((gear - none) ** 2))


@pytest.mark.parametrize("other", [load, directed, stribeck], ids=lambda f: f.__name__)
def test_other_friction_of_the_joint_is_not_asked_for_it(
    tmp_path: Path, other: Callable[[mujoco.MjData], float]
) -> None:
    moved = motion(scene(tmp_path), simulate(ARM, push(other)()))
    assert not GEAR.shapes(moved, AT)


@pytest.mark.parametrize("gain", [50.0, 72.0])
def test_a_drive_of_another_strength_is_none(tmp_path: Path, gain: float) -> None:
    drive = 'gainprm="60" biastype="affine" biasprm="0 -60 -3"'
    own = drive.replace("60", f"{gain:g}").replace("-3", f"{-gain / 20.0:g}")
    moved = motion(scene(tmp_path), simulate(ARM.replace(drive, own)))
    assert not GEAR.shapes(moved, AT)


def test_where_both_losses_may_be_alike_it_is_friction_by_load(tmp_path: Path) -> None:
    moved = motion(scene(tmp_path), simulate(ARM, push(lossy)()))
    assert GEAR.shapes(moved, AT) == [()]
    known = Planted(GEAR, AT, LOSSES)
    told = BOUNDS | {"drive": (0.08, 0.12), "back": (0.3, 0.4)}
    assert known.simpler(moved, told) is None
    assert known.become(moved) is None
    same = known.simpler(moved, told | {"back": (0.11, 0.4)})
    assert same is not None
    assert same.effect.id == "joint.friction_load"
    assert same.theta == pytest.approx([0.3, 0.225])
    became = Planted(GEAR, AT, np.array([0.2, 0.22, 0.3, 0.2])).become(moved)
    assert became is not None
    assert became.effect.id == "joint.friction_load"
    ((shape, start),) = same.beyond(GEAR, moved)
    assert not shape
    assert start == pytest.approx([0.225, 0.225, 0.3, 0.0])


def test_a_bristle_holds_the_larger_friction_while_it_trembles() -> None:
    h, inertia = 1e-3, 0.5
    own = np.array([0.0, inertia])
    for _ in range(200):
        pushed = slip(1.0, 4.0, -0.5, h, own)
    assert pushed == pytest.approx(4.0)
    held = [slip(1.0, 4.0, v, h, own) for v in (1e-6, -1e-6) * 20]
    # friction of the other way, as of the velocity's sign, would let it go
    assert min(held) > 3.9
