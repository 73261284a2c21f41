"""Whole trials: nothing hidden means nothing to see, seeds decide all, and nobody peeks."""

from __future__ import annotations

import ast
import dataclasses
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import get_args

import mujoco
import numpy as np
import pytest

from wt.errors import ConfigError
from wt.prove import legged_catalog, moving_laws
from wt.prove.cases import Case, HiddenEffect, cases
from wt.prove.catalog import LATER, LIBRARY, OUTSIDERS
from wt.prove.hidden import HiddenTrajectory, Plant
from wt.prove.motions import MOTIONS, reference
from wt.prove.places import places
from wt.prove.rigs import RIGS, RigName, nominal_xml
from wt.prove.sensing import Sensing, measure, sample_steps
from wt.prove.sets import Decoy
from wt.prove.visibility import visibilities, visibility
from wt.prove.world import LAWS, build, hidden_plant, record

SHARP = Sensing(rate=100.0, bits=17, noise=0.0, qvel="none")
TRIED = {
    "sysid_rival.py", "sysid_ranges.py", "marks.py", "page.py", "page_tables.py", "film.py",
}  # fmt: skip
"""Modules that are tried on the hidden worlds, or show how that went; so are those of rivals/."""


def short(case: Case, **changes: object) -> Case:
    return dataclasses.replace(case, **({"seconds": 4.0} | changes))


def replay(xml: str, u: np.ndarray, q0: np.ndarray, steps: int, h: float) -> np.ndarray:
    """Positions under held commands in plain MuJoCo, from a robot at rest under the first one."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = h
    data = mujoco.MjData(model)
    data.qpos[:] = q0
    data.ctrl[:] = u[0]
    mujoco.mj_step(model, data, round(1.5 / h))
    out = []
    for row in u:
        out.append(data.qpos.copy())
        data.ctrl[:] = row
        mujoco.mj_step(model, data, steps)
    return np.array(out)


@pytest.mark.parametrize("rig", ["pendulum", "arm3", "arm6"])
def test_nothing_hidden_is_what_mujoco_makes_of_the_nominal_model(rig: str) -> None:
    case = short(cases("nulls")[0], rig=rig, sensing=SHARP, gain=1.0)
    plant = Plant(RIGS[rig], [], 1.0, np.ones((2, len(RIGS[rig].links))))
    trace, _ = record(case, plant, 0)
    # MuJoCo's own stepping is of first order: two step sizes give the limit
    coarse, fine = (
        replay(nominal_xml(RIGS[rig]), trace.u, trace.u[0], n, 0.01 / n) for n in (25, 50)
    )
    assert np.abs(trace.q - (2 * fine - coarse)).max() < 3e-5
    assert np.ptp(trace.q, axis=0).min() > 0.1


def test_the_few_per_cent_are_seen_and_small() -> None:
    case = short(cases("nulls")[0], rig="arm3", sensing=SHARP, gain=1.0)
    world = build(case)
    u = np.stack([world.fit[0].columns[f"ctrl/{a}"] for a in RIGS["arm3"].actuators], axis=1)
    q = np.stack(list(world.clean[0].values()), axis=1)
    error = np.abs(q - replay(world.nominal_xml, u, u[0], 20, 5e-4))
    assert 1e-4 < error.max() < 0.02


def test_step_size_hardly_matters() -> None:
    case = short(cases("nulls")[0], rig="arm3", sensing=SHARP, gain=1.0, seconds=3.0)
    traces = [
        record(case, Plant(RIGS["arm3"], [], 1.0, np.ones((2, 3)), step=h), 0)[0]
        for h in (0.0005, 0.000125)
    ]
    assert np.abs(traces[0].q - traces[1].q).max() < 2e-5


def test_same_seed_same_world() -> None:
    assert cases("full", 3) == cases("full", 3)
    assert cases("full", 3) != cases("full", 4)
    case = short(cases("singles")[1], seconds=2.5)
    first, second = build(case), build(case)
    for a, b in zip(first.fit + first.holdout, second.fit + second.holdout, strict=True):
        assert (a.t == b.t).all()
        assert all(np.array_equal(a.columns[n], b.columns[n], equal_nan=True) for n in a.columns)
    other = build(dataclasses.replace(case, seed=case.seed + 1))
    assert not np.array_equal(other.clean[0]["elbow"], first.clean[0]["elbow"])


def test_the_full_set_holds_what_it_promises() -> None:
    full = cases("full")
    assert len(full) >= 200
    assert len({case.name for case in full}) == len(full)
    kinds = Counter(case.kind for case in full)
    assert kinds["null"] >= 50
    assert min(kinds["pair"], kinds["outsider"]) >= 10
    assert kinds["triple"] >= 8
    assert {case.decoy for case in full} == set(get_args(Decoy))
    assert {case.rig for case in full} == set(get_args(RigName))
    said = {truth.law for case in full for truth in case.truth}
    first = set(LIBRARY) | set(OUTSIDERS)
    assert first < said < first | set(LATER)
    assert {case.level for case in full} == {"obvious", "clear", "faint", "below", ""}
    assert {truth.effect for c in full if c.kind == "outsider" for truth in c.truth} == {"unknown"}
    for case in full:
        if case.kind in ("pair", "triple"):
            assert len({truth.name.removesuffix("_drive") for truth in case.truth}) == len(
                case.truth
            )
    assert {c.kind for c in cases("quick")} == {"single", "pair", "outsider", "null"}
    assert {c.kind for c in cases("brief")} == {"single", "pair", "outsider", "null"}
    assert len(cases("brief")) == 10
    with pytest.raises(ConfigError, match="set of trials 'fool'; allowed: brief, quick, full"):
        cases("fool")


def test_every_effect_of_the_list_has_a_law_and_a_place() -> None:
    sensors = {effect for effect in LIBRARY if effect.startswith("sensor.")}
    later = set(LATER) | set(legged_catalog.MAGNITUDES) | set(moving_laws.LAWS)
    assert set(LIBRARY) | set(OUTSIDERS) | later == set(LAWS) | sensors
    assert all(places(effect, "arm6") and places(effect, "arm3") for effect in LIBRARY)


@pytest.mark.parametrize("index", [0, 1])
def test_recordings_are_what_the_sensing_says(index: int) -> None:
    missing = ("rows", "nan")[index]
    sensing = Sensing(rate=200.0, bits=13, noise=4e-4, jitter=0.1, drops=0.05, missing=missing,  # type: ignore[arg-type]
                      clock=("loop", "stamps")[index], qvel="filtered", gyro=True)  # fmt: skip
    case = short(cases("nulls")[0], rig="arm3", sensing=sensing, seconds=5.0, gain=1.0)
    world = build(case)
    model = mujoco.MjModel.from_xml_string(world.nominal_xml)
    recording = world.fit[0]
    for name in recording.columns:
        group, rest = name.split("/", 1)
        kind = {"ctrl": "ACTUATOR", "qpos": "JOINT", "qvel": "JOINT", "sensor": "SENSOR"}[group]
        kind_id = getattr(mujoco.mjtObj, f"mjOBJ_{kind}")
        assert mujoco.mj_name2id(model, kind_id, rest.split("/")[0]) >= 0
    q = recording.columns["qpos/elbow"]
    step = 2 * np.pi / 2**13
    seen = np.isfinite(q)
    np.testing.assert_allclose(q[seen] / step, np.rint(q[seen] / step), atol=1e-6)
    expected = np.sqrt(4e-4**2 + step**2 / 12)
    error = (q - world.clean[0]["elbow"])[seen]
    assert np.sqrt((error**2).mean()) == pytest.approx(expected, rel=0.1)
    assert world.noise_rms["elbow"] == pytest.approx(expected, rel=0.05)
    lost = 1000 - len(recording) if missing == "rows" else int((~seen).sum())
    assert 25 <= lost <= 80
    assert len(recording) == 1000 or missing == "rows"
    assert (np.diff(recording.t) > 0).all()
    assert np.abs(np.diff(recording.t) - 0.005).max() > 5e-4


def test_sensor_effects() -> None:
    rig, h = RIGS["arm3"], 0.0005
    steps = sample_steps(SHARP, 3.0, h, np.random.default_rng(0))
    trace = HiddenTrajectory(len(steps), 3, int(steps[-1]) + 1, h)
    t = np.arange(len(trace.fine_q)) * h
    trace.fine_q[:] = np.sin(2 * t)[:, None]
    trace.fine_v[:] = 2 * np.cos(2 * t)[:, None]
    trace.q[:], trace.v[:] = trace.fine_q[steps], trace.fine_v[steps]
    rng = np.random.default_rng(1)

    def seen(effect: str, place: str, **parameters: object) -> dict[str, np.ndarray]:
        return measure(rig, SHARP, trace, steps, [(effect, place, parameters)], rng)[0]

    at, close = steps * h, 2.5e-5
    offset = seen("sensor.offset", "elbow", offset=0.1)
    np.testing.assert_allclose(offset["qpos/elbow"], np.sin(2 * at) + 0.1, atol=close)
    np.testing.assert_allclose(offset["qpos/waist"], np.sin(2 * at), atol=close)
    scale = seen("sensor.scale", "elbow", factor=1.1)["qpos/elbow"]
    np.testing.assert_allclose(scale, 1.1 * np.sin(2 * at), atol=close)
    late = seen("sensor.delay", "all", delay=0.0123)
    for joint in rig.joints:
        shifted = np.sin(2 * np.maximum(at - 0.0123, 0))
        np.testing.assert_allclose(late[f"qpos/{joint}"], shifted, atol=close)
    coarse = seen("sensor.quantization", "waist", step=0.02)["qpos/waist"]
    np.testing.assert_allclose(coarse, 0.02 * np.rint(np.sin(2 * at) / 0.02), atol=0.0100001)
    assert len(np.unique(np.round(coarse / 0.02, 6))) <= 101


@pytest.mark.parametrize("kind", MOTIONS)
def test_motions_stay_within_their_limits(kind: str) -> None:
    t, middle, amplitude = np.arange(0, 18, 0.01), np.array([0.2, -1.0]), np.array([0.5, 0.9])
    for seed in range(4):
        path = reference(kind, t, middle, amplitude, 1.0, np.random.default_rng(seed))
        assert path.shape == (len(t), 2)
        assert (np.abs(path - middle) <= amplitude + 1e-9).all()
        assert (np.ptp(path, axis=0) > 0.5 * amplitude).all()


def test_first_rows_keep_their_places() -> None:
    """What comes later is appended, so that names and seeds of earlier cases stay."""
    names = [case.name for case in cases("full")]
    assert names[0] == "000-arm6-joint.friction_coulomb-obvious"
    assert names[97] == "097-arm3-world.gravity-obvious"
    assert (names[98][:6], names[110][:6], names[123][:6]) == ("098-ar", "110-ar", "123-ar")
    assert names[164] == "164-arm3-poor_excitation"
    assert [case.kind for case in cases("full")[98:124]] == (
        ["pair"] * 12 + ["outsider"] * 13 + ["null"]
    )


@pytest.mark.long
def test_below_the_noise_is_below_it() -> None:
    for case in cases("faintest"):
        if case.rig in ("arm3", "pendulum"):
            assert visibility(short(case, seconds=6.0)) < 1.0, case.name


def test_each_effect_has_a_size_of_its_own() -> None:
    case = next(c for c in cases("triples") if c.rig == "arm3")
    case = short(case, seconds=4.0)
    sizes = visibilities(case)
    assert len(sizes) == 3
    only = dataclasses.replace(case, truth=case.truth[:1])
    # alone or beside others: about the same
    assert visibility(only) == pytest.approx(sizes[0], rel=0.2)
    assert min(sizes) > 3.0


def test_a_passive_joint_is_not_driven_and_hangs() -> None:
    rig = RIGS["arm2_passive"]
    assert (rig.joints, rig.actuators) == (("crank", "trailer"), ("crank_drive",))
    assert rig.hanging([0.7, 2.0]) == [0.7, -0.7]
    case = short(next(c for c in cases("full") if c.rig == rig.name and not c.truth))
    world = build(case)
    assert [c for c in world.fit[0].columns if c.startswith("ctrl/")] == ["ctrl/crank_drive"]
    assert np.ptp(world.clean[0]["trailer"]) > 0.1
    # at rest at first: it hangs
    start = world.clean[0]["crank"][0] + world.clean[0]["trailer"][0]
    assert start == pytest.approx(0.0, abs=0.03)


def test_a_wrong_mass_is_one_body_of_its_own() -> None:
    case = next(c for c in cases("full") if c.decoy == "wrong_mass")
    _, _, body = case.excused[0]
    plants = [hidden_plant(c) for c in (case, dataclasses.replace(case, decoy=""))]
    ratio = plants[0].model.body_mass / np.maximum(plants[1].model.body_mass, 1e-9)
    wrong = plants[0].body(body)
    nominal = RIGS[case.rig].links[RIGS[case.rig].bodies.index(body)].mass
    assert 0.06 <= abs(plants[0].model.body_mass[wrong] / nominal - 1.0) <= 0.1
    assert np.delete(ratio[1:], wrong - 1) == pytest.approx(1.0)


def test_faint_is_still_above_the_noise() -> None:
    few = ("joint.friction_coulomb", "actuator.lag", "joint.hysteresis", "sensor.offset")
    faint = [c for c in cases("singles") if c.level == "faint" and c.rig in ("arm3", "pendulum")]
    chosen = [c for c in faint if c.truth[0].effect in few]
    assert chosen
    for case in chosen:
        assert visibility(short(case, seconds=8.0)) > 2.0, case.name


def test_nobody_peeks() -> None:
    """The hidden worlds import nothing of the physics that they are to try."""
    root = Path(__file__).resolve().parents[2]
    for file in (root / "wt" / "prove").rglob("*.py"):
        if file.name in TRIED or file.parent.name == "rivals":
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not [n for n in names if n.startswith(("wt.physics", "wt.diagnose"))], file
    code = (
        "import sys; import wt.prove.world, wt.prove.score; "
        "sys.exit(any(m.startswith(('wt.physics', 'wt.diagnose', 'torch')) for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=root, check=False).returncode == 0


def test_truth_is_in_the_words_of_the_interface() -> None:
    for case in cases("full"):
        for truth in case.truth:
            assert isinstance(truth, HiddenEffect)
            rig = RIGS[case.rig]
            names = {
                "joint": rig.joints, "actuator": (*rig.actuators, "all"),
                "body": (*rig.bodies, "all"),
                "sensor": ("all",), "world": ("world",),
            }.get(truth.kind)  # fmt: skip
            assert names is None or truth.name in names, truth
