"""Each effect against a machine that has it, which this repository's effects had no part in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import Run, coefficients, motion, scene, simulate
from tests.physics.laws import push
from tests.physics.truths import TRUTHS, Truth, untold
from wt.physics import effect as registry
from wt.physics.effect import Effect, Parameter, Shape, effects
from wt.physics.hooks import FromRecordings, shaped
from wt.physics.motion import Motion
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.units import HINGE, Units
from wt.types import Location

KNOWN = pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: f"{t.id}-{t.at.name}")
LOOSEST = 0.15
"""No truth is any if a replay may be further off, as a share of what the effect does."""
_RUNS: dict[Truth, Run] = {}
_NOMINAL: dict[str, Run] = {}


def run_of(truth: Truth) -> Run:
    """The simulated recording, computed once."""
    if truth not in _RUNS:
        _RUNS[truth] = truth.machine()
    return _RUNS[truth]


def nominal(xml: str) -> Run:
    """A recording of the machine as the model has it, computed once."""
    if xml not in _NOMINAL:
        _NOMINAL[xml] = simulate(xml)
    return _NOMINAL[xml]


def check_signature(truth: Truth, folder: Path) -> None:
    """The force that is missing, by least squares, is the effect's with the right parameters."""
    effect = effects()[truth.id]
    moved = motion(scene(folder, truth.model), run_of(truth))
    shapes = effect.shapes(moved, truth.at)
    if truth.fits is None:
        reads = isinstance(effect, FromRecordings) and effect.reads_residual
        assert reads or not shapes, "it has a signature: say how well that fits"
        for shape in shapes:
            assert effect.columns(moved, truth.at, shape).shape[:2] == moved.q.shape
        return
    shape = truth.shape or shapes[0]
    found, left = coefficients(moved, effect.columns(moved, truth.at, shape))
    theta = effect.theta(found, shape)
    assert theta == pytest.approx(np.array(truth.theta), rel=truth.fits, abs=truth.fits * 0.05)
    assert left < truth.leaves
    if truth.shape == truth.theta:
        assert found == pytest.approx(1.0, rel=truth.fits)
    for sign, value in zip(shaped(effect, shape).signed, found, strict=False):
        assert sign * value >= 0.0


def check_possible(truth: Truth, folder: Path) -> None:
    """Nothing that the machine does is said to rule out what it has."""
    moved = motion(scene(folder, truth.model), run_of(truth))
    said = effects()[truth.id].contradiction(moved, truth.at, np.array(truth.theta))
    assert said is None


def check_replay(truth: Truth, folder: Path) -> None:
    """A replay with the effect follows the machine that has it."""
    run, before = run_of(truth), nominal(truth.model)
    stretch = Stretch(0, run.t, run.held, run.q[0], run.v[0])
    effect = shaped(effects()[truth.id], truth.shape)
    planted = Planted(effect, truth.at, np.array(truth.theta))
    replay = Replayer(scene(folder, truth.model), [stretch]).run([[planted]])
    influence = np.sqrt(np.mean((run.q - before.q) ** 2))
    error = np.sqrt(np.mean((replay.q[0] - run.q) ** 2))
    assert influence > 1e-4
    assert truth.replays <= LOOSEST
    assert error < truth.replays * influence


def test_every_effect_has_a_truth() -> None:
    assert untold(TRUTHS) == set()


@KNOWN
def test_signature_recovers_the_parameters(truth: Truth, tmp_path: Path) -> None:
    check_signature(truth, tmp_path)


@KNOWN
def test_no_recording_rules_out_the_truth(truth: Truth, tmp_path: Path) -> None:
    check_possible(truth, tmp_path)


@KNOWN
def test_replay_follows_the_machine(truth: Truth, tmp_path: Path) -> None:
    check_replay(truth, tmp_path)


# -- a new effect is not believed


class Cubic(Effect):
    """τ = −coefficient · v³, or with another sign."""

    id = "joint.friction_cubic"
    kind = "joint"
    parameters = (Parameter("coefficient", "N·m·s³/rad³", 0.0, 1e3, 1e-4, neutral=0.0),)
    reference = "none"
    signed = (1,)

    def __init__(self, sign: float) -> None:
        self.sign = sign

    def columns(self, motion: Motion, at: Location, shape: Shape) -> np.ndarray:
        dof = motion.scene.dof(at.name)
        return motion.on(dof, self.sign * motion.v[:, dof] ** 3)

    def theta(self, coefficients: np.ndarray, shape: Shape) -> np.ndarray:
        return coefficients

    def patch(self, spec: mujoco.MjSpec, at: Location, theta: np.ndarray) -> None:
        spec.joint(at.name).damping[2] -= self.sign * theta[0]

    def statement(self, at: Location, theta: np.ndarray, units: Units = HINGE) -> str:
        return f"Joint {at.name} is braked by {theta[0]:.3g} {units.force} at 1 {units.speed}."


CUBIC = Truth(Cubic.id, Location("joint", "j1"), (0.2,), hook=push(lambda d: -0.2 * d.qvel[1] ** 3))


@pytest.fixture
def added(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The registry with a cubic friction of some sign in it."""
    monkeypatch.setitem(registry._EFFECTS, Cubic.id, Cubic(request.param))


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize("added", [-1.0], indirect=True)
def test_a_new_effect_needs_a_truth(tmp_path: Path) -> None:
    assert untold(TRUTHS) == {Cubic.id}
    assert untold([*TRUTHS, CUBIC]) == set()
    check_signature(CUBIC, tmp_path)
    check_replay(CUBIC, tmp_path)


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize("added", [1.0], indirect=True)
@pytest.mark.parametrize("check", [check_signature, check_replay])
def test_a_new_effect_with_the_wrong_sign_is_found_out(check, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    with pytest.raises(AssertionError):
        check(CUBIC, tmp_path)


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize("added", [-1.0], indirect=True)
def test_a_truth_that_leaves_out_the_signature_is_none(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="it has a signature"):
        check_signature(replace(CUBIC, fits=None), tmp_path)
