from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import onnxruntime as ort
import pytest
from scipy.ndimage import gaussian_filter1d

from tests.diagnose.hidden_forces import STEP, World, on_joint, world
from wt.diagnose.selection.naming import rivals_nonparametric
from wt.diagnose.thresholds import THRESHOLDS
from wt.diagnose.unknown.choice import choose
from wt.diagnose.unknown.fit import ForceData
from wt.diagnose.unknown.force import Unknown, find
from wt.diagnose.unknown.law import Atom, Law
from wt.diagnose.unknown.onnx import to_onnx
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

J2, J1 = Location("joint", "j2"), Location("joint", "j1")


def detent(q: float, v: float) -> float:
    """Pulls towards 0.7 rad, at most 0.7·√2⁻¹·e^−½ N·m."""
    s = (q - 0.7) / 0.15
    return float(-0.7 * s * np.exp(-(s**2)))


def brake(q: float, v: float) -> float:
    """Viscous around 0.2 rad only."""
    return float(-1.5 * v * np.exp(-(((q - 0.2) / 0.2) ** 2)))


def dry(q: float, v: float) -> float:
    """Coulomb friction, rounded over 2 mrad/s."""
    return float(-0.5 * np.tanh(v / 0.002))


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], World]:
    """Two-joint worlds by the name of what is hidden in j2, each made once."""
    laws = {"detent": detent, "brake": brake, "dry": dry}
    made: dict[str, World] = {}

    def of(name: str) -> World:
        if name not in made:
            hidden = on_joint(1, laws[name]) if name in laws else None
            made[name] = world(tmp_path_factory.mktemp(name), 2, hidden)
        return made[name]

    return of


@pytest.fixture(scope="module")
def found(worlds: Callable[[str], World]) -> Callable[[str], Unknown]:
    """What is learned in each world, once."""

    @functools.cache
    def of(name: str) -> Unknown:
        w = worlds(name)
        learned, *_ = find(w.screen, w.objective, w.objective.reference(()), w.held, step=STEP)
        assert learned.proven
        return learned

    return of


def infer(graph: bytes, inputs: dict[str, np.ndarray]) -> np.ndarray:
    session = ort.InferenceSession(graph, providers=["CPUExecutionProvider"])
    feeds = {name: x.astype(np.float32).reshape(-1, 1) for name, x in inputs.items()}
    return np.asarray(session.run(["force"], feeds)[0])


@pytest.mark.parametrize(
    ("name", "law", "columns", "near"),
    [("detent", detent, ("qpos/j2",), 0.7), ("brake", brake, ("qpos/j2", "qvel/j2"), 0.2)],
)
def test_unknown_force_is_learned_and_improves_replays(
    worlds: Callable[[str], World],
    found: Callable[[str], Unknown],
    name: str,
    law: Callable[[float, float], float],
    columns: tuple[str, ...],
    near: float,
) -> None:
    w, force = worlds(name), found(name)
    assert (force.planted.effect.id, force.planted.at) == ("unknown", J2)
    assert force.depends_on == columns
    assert force.gain.p_value < 0.01
    assert force.gain.share > 0.8
    assert force.r2 > 0.9
    assert all(c in force.formula for c in columns)
    said = float(force.statement.partition("strongest near ")[2].partition(" rad")[0])
    assert said == pytest.approx(near, abs=0.1)
    # the exported force against the one that was hidden, along the held-out motion
    motion = w.held.smoothed.motion
    values = {"qpos/j2": motion.q[:, 1], "qvel/j2": motion.v[:, 1]}
    got = infer(force.onnx, {c: values[c] for c in columns})[:, 0]
    true = np.array([law(q, v) for q, v in zip(motion.q[:, 1], motion.v[:, 1], strict=True)])
    assert np.sqrt(np.mean((got - true) ** 2)) < 0.2 * np.sqrt(np.mean(true**2))


def test_amplitude_zero_is_neutral(
    worlds: Callable[[str], World], found: Callable[[str], Unknown]
) -> None:
    w, there = worlds("detent"), found("detent").planted
    off = Planted(there.effect, there.at, np.zeros(1))
    plain, without, acting = (a.error for a in w.objective.evaluate([(), (off,), (there,)]))
    np.testing.assert_allclose(without, plain, atol=1e-9)
    assert np.abs(acting - plain).max() > 1e-4


def test_nothing_is_found_where_nothing_is_hidden(worlds: Callable[[str], World]) -> None:
    w = worlds("nothing")
    assert not find(w.screen, w.objective, w.objective.reference(()), w.held, step=STEP)


def test_what_held_out_recordings_do_not_show_is_suspected_and_not_proven(
    worlds: Callable[[str], World],
) -> None:
    """A brake that 110 times the noise showed was no mismatch, since no law of it was proven."""
    w, elsewhere = worlds("brake"), worlds("nothing").held
    (only,) = find(w.screen, w.objective, w.objective.reference(()), elsewhere, step=STEP)
    assert only.suspected and not only.proven
    assert only.planted.at == J2 and only.depends_on == ("qpos/j2", "qvel/j2")


def test_unknown_is_not_in_the_library() -> None:
    assert "unknown" not in effects()


def test_drift_is_not_predicted(worlds: Callable[[str], World]) -> None:
    """A slow random force depends on nothing recorded; only neighbours in time resemble it."""
    w = worlds("nothing")
    noise = np.random.default_rng(3).standard_normal(len(w.screen.rows))
    drift = gaussian_filter1d(noise, 0.4 / 0.025)  # remembers for about a second
    data = ForceData(w.screen, "j2", drift, np.ones(len(drift), bool), 0, STEP)
    fit, tried = choose(data)
    assert tried > 5
    assert fit.r2 < 0.4


LAW = Law(
    ("qpos/j2", "qvel/j2", "t"),
    np.array([-1.0, -2.0, 0.0]),
    np.array([1.0, 2.0, 10.0]),
    (
        (),
        (Atom(0, "linear"), Atom(1, "sign", 0.0, 0.05)),
        (Atom(1, "square"),),
        (Atom(0, "sin", 0.0, 2.0),),
        (Atom(0, "cos", 0.0, 3.0), Atom(1, "linear")),
        (Atom(0, "bump", 0.3, 0.2),),
        (Atom(0, "kink", -0.3, 0.1),),
        (Atom(1, "side", 0.0, -1.0), Atom(0, "linear")),
        (Atom(1, "size"),),
    ),
    np.array([0.1, 1.0, -0.2, 0.3, 0.4, -0.5, 0.6, 0.7, -0.8]),
)


def closed_form(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    s = (q + 0.3) / 0.1
    return (
        0.1
        + q * np.tanh(v / 0.05)
        - 0.2 * np.abs(v) * v
        + 0.3 * np.sin(2 * q)
        + 0.4 * np.cos(3 * q) * v
        - 0.5 * np.exp(-(((q - 0.3) / 0.2) ** 2))
        + 0.6 * s * np.exp(-(s**2))
        + 0.7 * np.maximum(-v, 0.0) * q
        - 0.8 * np.abs(v)
    )


def test_onnx_agrees_with_python_and_closed_form() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(LAW.low, LAW.high, (500, 3)).astype(np.float32).astype(float)
    got = infer(to_onnx({"force": LAW}), dict(zip(LAW.columns, x.T, strict=True)))
    assert got.shape == (500, 1)
    np.testing.assert_allclose(got[:, 0], LAW.force(x), atol=1e-5)
    np.testing.assert_allclose(LAW.force(x), closed_form(x[:, 0], x[:, 1]), atol=1e-12)


def test_force_ends_outside_of_what_was_seen() -> None:
    x = np.array([[1.0, 0.5, 5.0], [1.25, 0.5, 5.0], [1.51, 0.5, 5.0], [-3.0, 0.5, 5.0]])
    force = LAW.force(x)
    edge = closed_form(np.array([1.0]), np.array([0.5]))[0]
    # half of the margin of a quarter of the range: half of the force
    np.testing.assert_allclose(force, [edge, 0.5 * edge, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(
        infer(to_onnx({"force": LAW}), dict(zip(LAW.columns, x.T, strict=True)))[:, 0],
        force,
        atol=1e-5,
    )


def test_formula_reads_as_the_law() -> None:
    text = LAW.text()
    assert text.startswith("0.1 + 1·qpos/j2·sign(qvel/j2) - 0.2·|qvel/j2|·qvel/j2 + 0.3·sin(2·qpos")
    assert "- 0.5·exp(-((qpos/j2 - 0.3)/0.2)^2)" in text
    assert text.endswith("+ 0.7·max(-qvel/j2, 0)·qpos/j2 - 0.8·|qvel/j2|")


def planted(effect: str, theta: list[float]) -> Planted:
    return Planted(effects()[effect], J2, np.array(theta))


def test_a_true_name_is_kept(worlds: Callable[[str], World]) -> None:
    hypothesis = (planted("joint.friction_coulomb", [0.5]),)
    rivalry = rivals_nonparametric(worlds("dry").screen, hypothesis, 0)
    assert rivalry is not None
    assert rivalry.ratio > THRESHOLDS.doubtful
    assert rivalry.r2 > 0.95


@pytest.mark.parametrize(
    ("name", "effect", "theta"),
    [
        ("detent", "joint.stiffness", [0.3, 0.7]),
        ("brake", "joint.friction_viscous", [0.5]),
    ],
)
def test_a_wrong_name_is_given_up(
    worlds: Callable[[str], World], name: str, effect: str, theta: list[float]
) -> None:
    rivalry = rivals_nonparametric(worlds(name).screen, (planted(effect, theta),), 0)
    assert rivalry is not None
    assert rivalry.ratio < 0.5 * THRESHOLDS.doubtful
    assert rivalry.nats > 50.0
    assert "qpos/j2" in rivalry.depends_on


def test_what_was_only_read_off_is_given_up_for_what_predicts(
    worlds: Callable[[str], World],
) -> None:
    """A detent pulls at times of its own, too: whenever the joint comes by."""
    screen, at = worlds("detent").screen, Location("body", "link2")
    (pushes,) = screen.rank((), {("body.force_intermittent", at)})
    assert pushes.planted.observed()
    rivalry = rivals_nonparametric(screen, (pushes.planted,), 0)
    assert rivalry is not None
    assert rivalry.ratio < 0.5 * THRESHOLDS.doubtful
    assert "qpos/j2" in rivalry.depends_on


def test_no_comparison_where_the_effect_is_not_at_one_joint(
    worlds: Callable[[str], World],
) -> None:
    body = Planted(effects()["body.mass"], Location("body", "link2"), np.array([1.1]))
    assert rivals_nonparametric(worlds("dry").screen, (body,), 0) is None
