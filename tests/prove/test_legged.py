"""Robots on legs: they stand, they are recorded as said, and their cases are what they promise."""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter

import mujoco
import numpy as np
import pytest

from wt.data.recording import check_against
from wt.prove import legs, replay
from wt.prove.base_sensing import BaseSensing, measure_base
from wt.prove.case import Case
from wt.prove.cases import cases
from wt.prove.hidden import Plant
from wt.prove.legged_motions import MOTIONS, reference
from wt.prove.legged_rigs import HUMANOID, LEGGED, QUADRUPED, QUADRUPED_LEGS, SIDES
from wt.prove.legged_world import CALM, upright
from wt.prove.rigs import RIGS, nominal_xml
from wt.prove.score import PARAMETERS
from wt.prove.trajectory import HiddenTrajectory
from wt.prove.visibility import visibility
from wt.prove.world import build


def short(case: Case, **changes: object) -> Case:
    return dataclasses.replace(case, **({"seconds": 3.0} | changes))


@functools.lru_cache
def legged() -> list[Case]:
    return cases("legged")


def find(part: str) -> Case:
    return next(case for case in legged() if part in case.name)


def test_the_set_holds_what_it_promises() -> None:
    every = legged()
    kinds, rigs = Counter(c.kind for c in every), Counter(c.rig for c in every)
    assert len(every) >= 100
    assert len({case.name for case in every}) == len(every)
    assert kinds["null"] >= 20
    assert kinds["outsider"] >= 8
    assert min(rigs["humanoid"], rigs["arm3"] + rigs["arm6"]) >= 10
    assert rigs["quadruped"] >= 50
    assert cases("legged") == every
    assert not {case.rig for case in cases("full")} & set(LEGGED)


def test_truth_is_in_the_words_of_the_interface() -> None:
    kinds = {
        "joint": mujoco.mjtObj.mjOBJ_JOINT, "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
        "body": mujoco.mjtObj.mjOBJ_BODY, "geom": mujoco.mjtObj.mjOBJ_GEOM,
    }  # fmt: skip
    models = {n: mujoco.MjModel.from_xml_string(nominal_xml(rig)) for n, rig in RIGS.items()}
    for case in legged():
        for truth in case.truth:
            places = ((truth.kind, truth.name), *truth.accept)
            for kind, name in places:
                known = name == "world" if kind == "world" else (
                    mujoco.mj_name2id(models[case.rig], kinds[kind], name) >= 0
                )  # fmt: skip
                assert known, truth
            if truth.effect == "unknown":
                assert case.kind == "outsider"
            else:
                assert set(PARAMETERS[truth.effect]) <= set(truth.parameters), truth


def test_feet_go_where_they_are_told() -> None:
    rng = np.random.default_rng(0)
    for rig in (QUADRUPED, HUMANOID):
        model = mujoco.MjModel.from_xml_string(nominal_xml(rig))
        data = mujoco.MjData(model)
        angles = rig.middle + rng.uniform(-0.2, 0.2, len(rig.links))
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *angles]
        mujoco.mj_kinematics(model, data)
        if rig is QUADRUPED:
            feet = [data.geom(f"{leg}_foot").xpos[None] for leg in QUADRUPED_LEGS]
            found = [legs.paw(leg, foot)[0] for leg, foot in zip(QUADRUPED_LEGS, feet, strict=True)]
        else:
            found = [
                legs.leg(
                    side,
                    data.body(f"{side}_ankle").xpos[None],
                    data.body(f"{side}_sole").xmat.reshape(1, 3, 3),
                )[0]
                for side in SIDES
            ]
        np.testing.assert_allclose(np.concatenate(found), angles[:12], atol=1e-9)


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_motions_keep_the_robot_on_its_feet(name: str) -> None:
    rig = LEGGED[name]
    plant = Plant(rig, [], 1.0, np.ones((2, len(rig.links))), step=0.001)
    t = np.arange(0, 4, 0.01)
    low, high = np.array([link.span for link in rig.links]).T
    for kind in MOTIONS[name]:
        path = reference(rig, kind, t, 1.0, np.random.default_rng(1))
        assert ((low < path) & (path < high)).all()
        np.testing.assert_allclose(path[0, :12], rig.middle[:12], atol=0.2)
        trace = plant.run(path[0], np.arange(len(t)) * 10, lambda k, q, v, p=path: p[k], 500)
        assert upright(trace, rig), kind
        # every joint is moved, by each leg's at least
        assert np.ptp(trace.q, axis=0)[:12].min() > 0.01, kind


def test_a_fallen_robot_is_not_upright() -> None:
    trace = HiddenTrajectory(2, 12, 2, 0.001)
    trace.base_q[:] = [0, 0, QUADRUPED.height, 1, 0, 0, 0]
    assert upright(trace, QUADRUPED)
    trace.base_q[1, 3:] = [np.cos(0.5), np.sin(0.5), 0, 0]
    assert not upright(trace, QUADRUPED)


def test_nothing_hidden_is_what_mujoco_makes_of_the_nominal_model() -> None:
    """Two step sizes of plain MuJoCo, each of first order, give the limit."""
    rig = QUADRUPED
    t = np.arange(0, 1.5, 0.01)
    path = reference(rig, "sway", t, 0.5, np.random.default_rng(0))
    plant = Plant(rig, [], 1.0, np.ones((2, len(rig.links))))
    steps = np.arange(len(t)) * 20
    trace = plant.run(path[0], steps, lambda k, q, v: path[k], 1000)
    found = []
    for n in (20, 40):
        model = mujoco.MjModel.from_xml_string(nominal_xml(rig, 0.01 / n))
        data = mujoco.MjData(model)
        data.qpos[7:] = path[0]
        mujoco.mj_kinematics(model, data)
        data.qpos[2] -= min(data.geom(f.name).xpos[2] - f.size[0] for f in rig.feet)
        data.ctrl[:] = path[0]
        mujoco.mj_step(model, data, 50 * n)
        rows = []
        for row in path:
            rows.append(data.qpos.copy())
            data.ctrl[:] = row
            mujoco.mj_step(model, data, n)
        found.append(np.array(rows))
    limit = 2 * found[1] - found[0]
    # creep of soft contacts differs by a fraction of a millimetre
    assert np.abs(trace.q - limit[:, 7:]).max() < 5e-4
    assert np.abs(trace.base_q[:, :3] - limit[:, :3]).max() < 5e-4


def test_recordings_are_what_the_sensing_says() -> None:
    base = BaseSensing(position=7e-4, turn=1.5e-3, velocity=0.015, rate=4e-3, imu=True)
    case = find("quadruped-nothing")
    case = short(case, sensing=dataclasses.replace(case.sensing, base=base, qvel="noisy"))
    first, second = build(case), build(case)
    recording = first.fit[0]
    assert len(first.fit) == 2
    assert len(first.holdout) == 1
    check_against(recording, mujoco.MjModel.from_xml_string(first.nominal_xml))
    for name, column in recording.columns.items():
        assert np.array_equal(column, second.fit[0].columns[name], equal_nan=True), name
    expected = {f"qpos/base/{i}" for i in range(7)} | {f"qvel/base/{i}" for i in range(6)}
    expected |= {f"sensor/{n}/{i}" for n in ("gyro", "accelerometer") for i in range(3)}
    assert expected <= set(recording.columns)
    without = build(short(case, sensing=dataclasses.replace(case.sensing, qvel="none"))).fit[0]
    assert not [name for name in without.columns if name.startswith("qvel/")]


def test_noise_of_a_trunk() -> None:
    trace = HiddenTrajectory(4000, 12, 1, 0.001, sensors=6)
    trace.base_q[:] = [1.0, 2.0, 0.3, np.cos(0.2), 0.0, 0.0, np.sin(0.2)]
    noisy = BaseSensing(position=5e-4, turn=1e-3, velocity=0.01, rate=3e-3, imu=True)
    found = measure_base(noisy, trace, True, np.random.default_rng(0))
    assert found["qpos/base/1"].std() == pytest.approx(5e-4, rel=0.1)
    assert found["qvel/base/2"].std() == pytest.approx(0.01, rel=0.1)
    assert found["qvel/base/3"].std() == pytest.approx(3e-3, rel=0.1)
    quaternion = np.stack([found[f"qpos/base/{i}"] for i in range(3, 7)], axis=1)
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=1e-12)
    yaw = 2 * np.arctan2(quaternion[:, 3], quaternion[:, 0])
    assert yaw.mean() == pytest.approx(0.4, abs=1e-4)
    assert yaw.std() == pytest.approx(1e-3, rel=0.1)


def test_what_falls_moves_less() -> None:
    case = find("quadruped-nothing")
    world = build(short(case))
    assert world.calm == (1.0, 1.0, 1.0)
    assert list(CALM) == sorted(CALM, reverse=True)


def test_a_faint_effect_shows() -> None:
    case = find("quadruped-joint.friction_coulomb-faint")
    assert visibility(short(case, seconds=4.0)) > 3.0


def test_a_robot_that_floats_is_replayed_in_pieces() -> None:
    case = short(find("quadruped-body.payload_fixed-obvious"), seconds=4.0)
    world = build(case)
    given = mujoco.MjModel.from_xml_string(world.nominal_xml)
    spec = mujoco.MjSpec.from_string(world.nominal_xml)
    truth = case.truth[0].parameters
    spec.body("trunk").add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], pos=truth["position"],
        mass=truth["mass"], contype=0, conaffinity=0,
    )  # fmt: skip
    measured = replay.measure(world.holdout[0], given)
    assert not measured.servoed
    assert measured.base is not None
    assert measured.joints == QUADRUPED.joints
    before, after = (
        np.sqrt(np.nanmean((replay.replay(m, measured) - measured.q) ** 2))
        for m in (given, spec.compile())
    )
    assert after < 0.3 * before
