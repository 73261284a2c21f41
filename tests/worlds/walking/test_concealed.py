"""A payload that only R carries, and models that take the place of S's."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.worlds.walking.test_world import SMALL, world
from wt.data.recording import check_against
from wt.errors import ConfigError, ModelError
from wt.worlds import g1_model
from wt.worlds.walking.world import WalkingWorld

QUICK = {**SMALL, "timestep": 0.005}
TRUNK = 7


def with_load(folder: Path, mass: float) -> Path:
    """S's MJCF with a point mass on slides, as text, before the legs: their addresses shift."""
    spec = world("go2_concealed", **QUICK).description("sim")
    spec.compile()
    stand = list(spec.keys[0].qpos)
    text = spec.to_xml()
    load = (
        '<joint name="base" type="free"/><body name="load" pos="0 0 0.12">'
        f'<geom type="sphere" size="0.02" mass="{mass}" contype="0" conaffinity="0"/>'
        '<joint name="along" type="slide" axis="1 0 0" limited="true" range="-0.096 0.096" '
        f'damping="{mass}" solreflimit="0.01 1" armature="{0.4 * mass}"/>'
        '<joint name="across" type="slide" axis="0 1 0" limited="true" range="-0.046 0.046" '
        f'damping="{mass}" solreflimit="0.01 1" armature="{0.4 * mass}"/></body>'
    )
    pose = " ".join(f"{x:.10g}" for x in (*stand[:7], 0, 0, *stand[7:]))
    before, key, after = text.partition('<key name="stand" qpos="')
    assert key and '<joint name="base" type="free"/>' in before
    path = folder / "model.xml"
    head = before.replace('<joint name="base" type="free"/>', load)
    path.write_text(f'{head}{key}{pose}"{after.partition(chr(34))[2]}')
    return path


@pytest.fixture(scope="module")
def alone() -> WalkingWorld:
    return world("go2_concealed", **QUICK)


@pytest.fixture(scope="module")
def patched(tmp_path_factory: pytest.TempPathFactory) -> WalkingWorld:
    model = with_load(tmp_path_factory.mktemp("patched"), 5.0)
    return world("go2_concealed", **QUICK, model=str(model))


def test_only_r_carries_it(alone: WalkingWorld) -> None:
    masses = [alone.model(domain).body_mass.sum() for domain in ("sim", "real")]
    assert masses[1] - masses[0] == pytest.approx(5.2)
    assert alone.model("sim").njnt == 13 and alone.model("real").njnt == 14
    assert len(alone.spec.hidden) == TRUNK
    pairs = alone.pairs("test", 300, 1)
    assert np.isfinite(pairs.real.hidden).all()
    again = alone.sim_step(pairs.real.o, pairs.real.a, pairs.real.hidden)
    np.testing.assert_allclose(pairs.sim_next, again, atol=1e-6)


def test_a_secret_needs_something_to_hide() -> None:
    with pytest.raises(ConfigError, match=r"world.concealed .* world.payload is null"):
        world("go2_concealed", payload=None)


def test_joints_are_found_by_name(alone: WalkingWorld, tmp_path: Path) -> None:
    """A load of a milligram in front of the legs changes nothing, but addresses."""
    light = world("go2_concealed", **QUICK, model=str(with_load(tmp_path, 1e-6)))
    assert light.model("sim").joint("FL_hip_joint").qposadr[0] == 9
    t = alone.collect("sim", 300, 2)
    hidden = np.hstack([t.hidden, np.zeros((len(t), 4))])
    off = np.abs(light.sim_step(t.o, t.a, hidden) - t.s_next)
    assert np.quantile(off, 0.99) < 1e-3
    assert np.quantile(np.abs(light.sim_step(t.o, t.a, None) - t.nominal), 0.99) < 1e-3


def test_s_own_load_is_hidden_and_moves(patched: WalkingWorld) -> None:
    names = [channel.name for channel in patched.spec.hidden[TRUNK:]]
    assert names == ["qpos/along", "qpos/across", "qvel/along", "qvel/across"]
    sim = patched.collect("sim", 400, 3)
    assert 0.01 < np.abs(sim.hidden[:, TRUNK]).max() < 0.11
    again = patched.sim_step(sim.o, sim.a, sim.hidden)
    assert np.quantile(np.abs(again - sim.s_next), 0.99) < 1e-3
    # of R nobody knows it
    real = patched.collect("real", 400, 3)
    assert np.isnan(real.hidden[:, TRUNK:]).all() and np.isfinite(real.hidden[:, :TRUNK]).all()


def test_s_goes_along_with_r(alone: WalkingWorld, patched: WalkingWorld) -> None:
    pairs = patched.pairs("test", 400, 4)
    real, hidden = pairs.real, pairs.real.hidden
    begins = real.step == 0
    assert not hidden[begins, TRUNK:].any()
    # where its own last step left its load
    answer, after = patched.advance("sim", real.o, real.a, hidden)
    inside = np.flatnonzero(np.diff(real.episode) == 0)
    np.testing.assert_allclose(hidden[inside + 1, TRUNK:], after[inside, TRUNK:], atol=1e-5)
    np.testing.assert_allclose(pairs.sim_next, answer, atol=1e-4)
    # R's unpaired transitions do not say where S's load is: it goes along from rest there, too
    np.testing.assert_array_equal(patched.answers(patched.collect("real", 400, 4)), pairs.sim_next)
    # R's very ball is not known to it, and yet it explains most of what S alone cannot
    size = real.s_next.std(axis=0)

    def error(predicted: np.ndarray) -> float:
        return float(np.mean(((predicted - real.s_next) / size) ** 2))

    still = hidden.copy()
    still[:, TRUNK:] = 0.0
    at_rest = patched.sim_step(real.o, real.a, still)
    without = alone.sim_step(real.o, real.a, real.hidden[:, :TRUNK])
    assert error(pairs.sim_next) < 0.6 * error(at_rest) < 0.6 * error(without)


def test_rollouts_start_with_the_load_where_it_went(patched: WalkingWorld) -> None:
    truth = patched.truth(4, 20, 3, seed=1)
    start = truth.hidden[:, 20, TRUNK:]
    assert np.isfinite(start).all() and np.abs(start[:, :2]).max() > 5e-3


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, r"'.*other.xml' does not exist; name an MJCF"),
        ("<mujoco><worldbody>", r"'.*other.xml' is no MJCF that MuJoCo reads"),
        (
            "<mujoco><worldbody/></mujoco>",
            r"'.*other.xml' is no model of the go2: it has no joint 'base'",
        ),
        ("g1", r"is no model of the go2: it has no joint 'FL_hip_joint'; give the MJCF"),
    ],
)
def test_a_model_of_another_robot_is_refused(
    content: str | None, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "other.xml"
    if content == "g1":
        spec = g1_model.spec(g1_model.PUBLISHED, 0.005)
        spec.compile()
        content = spec.to_xml()
    if content is not None:
        path.write_text(content)
    with pytest.raises(ModelError, match=said):
        world("go2_concealed", **QUICK, model=str(path))


def test_a_step_that_does_not_divide_the_control_step_is_refused(tmp_path: Path) -> None:
    path = with_load(tmp_path, 1.0)
    path.write_text(path.read_text().replace('timestep="0.005"', 'timestep="0.003"'))
    with pytest.raises(ModelError, match=r"time step of 0\.003 s does not divide"):
        world("go2_concealed", **QUICK, model=str(path))


def test_recordings_are_of_the_walks_that_were_collected() -> None:
    alone = world("go2_concealed", **{**QUICK, "episode_steps": 120})
    t = alone.collect("real", 480, 5)
    first, second = alone.record(480, 5, 2)
    n, steps = 4, 120  # samples in a control step, control steps in an episode
    for recording, rows in (
        (first, t.select(np.arange(120))),
        (second, t.select(np.arange(120, 240))),
    ):
        assert len(recording) == n * steps and recording.rate_hz == pytest.approx(200.0)
        for i, joint in enumerate(alone.spec.joints):
            q, u = (recording.columns[f"{kind}/{joint}"][::n] for kind in ("qpos", "ctrl"))
            np.testing.assert_allclose(q, rows.o[:, 6 + i], atol=1.5e-3)
            np.testing.assert_allclose(u, rows.a[:, i], atol=1e-6)
        w, x, y, z = (recording.columns[f"qpos/base/{k}"] for k in (3, 4, 5, 6))
        down = np.array([2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1])
        np.testing.assert_allclose(down[:, ::n].T, rows.o[:, 3:6], atol=8e-3)
    model = mujoco.MjModel.from_xml_string(to_xml(alone))
    check_against(first, model)


def to_xml(w: WalkingWorld) -> str:
    spec = w.description("sim")
    spec.compile()
    return spec.to_xml()


def test_a_table_says_what_s_knows(alone: WalkingWorld, patched: WalkingWorld) -> None:
    assert alone.note is not None and "of what R carries it knows nothing" in alone.note
    assert patched.note is not None and "The simulator is a model from a file" in patched.note
    assert world("go2_payload", **QUICK).note is None
