"""The R5 model against the published figures, by kinematics and statics of our own."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.conftest import FromShared
from wt.errors import ConfigError
from wt.worlds.r5_model import ArmPhysics, build

PI = 3.1416
# The maker's R5a: origin xyz, roll, axis, mass and centre of mass of each link.
R5A = [
    ((0, 0, 0.0565), 0, (0, 0, 1), 0.096804, (0.0050395, -0.0077407, 0.020897)),
    ((0.02, 0, 0.047), 0, (0, 1, 0), 1.1988, (-0.12992, -0.0011822, -2.6366e-05)),
    ((-0.264, 0, 0), -PI, (0, 1, 0), 0.84082, (0.16181, 0.0011723, -0.05455)),
    ((0.245, -5e-05, -0.06), 0, (0, 1, 0), 0.12432, (0.041751, 0.0054236, -0.03337)),
    ((0.0702, 5e-05, -0.083391), 0, (0, 0, 1), 0.63601, (-8.3435e-05, -1.5428e-05, 0.052216)),
    ((0.025286, 0, 0.083391), PI, (1, 0, 0), 0.44089, (0.041697, 2.4368e-05, 0.00014464)),
]
FINGERS, FINGERS_AT = 2 * 0.064798, (0.08657, 0.0, 0.0)
BASE = 0.42272
POSES = np.array(
    [
        [0.0] * 6,
        [0.5, 1.2, 0.8, -0.4, 0.7, -1.1],
        [-2.0, 3.0, 2.5, 1.5, -1.5, 0.3],
        [2.6, 0.1, 3.1, -1.0, 1.2, 1.5],
    ]
)


def chain(q: np.ndarray) -> list[tuple[np.ndarray, Rotation]]:
    """Position and orientation of each link by the textbook product of transforms."""
    frames, p, r = [], np.zeros(3), Rotation.identity()
    for (xyz, roll, axis, _, _), angle in zip(R5A, q, strict=True):
        p = p + r.apply(xyz)
        r = r * Rotation.from_euler("x", roll) * Rotation.from_rotvec(angle * np.array(axis))
        frames.append((p, r))
    return frames


def potential(q: np.ndarray) -> float:
    """Potential energy of the moving links [J]."""
    frames = chain(q)
    links = [(m, f) for (_, _, _, m, _), f in zip(R5A, frames, strict=True)]
    coms = [com for *_, com in R5A]
    heights = [m * (p + r.apply(c))[2] for (m, (p, r)), c in zip(links, coms, strict=True)]
    p, r = frames[-1]
    return 9.81 * (sum(heights) + FINGERS * (p + r.apply(FINGERS_AT))[2])


def physics(**changes: tuple[float, ...]) -> ArmPhysics:
    published = ArmPhysics(
        stiffness=(80.0, 80.0, 80.0, 40.0, 10.0, 10.0),
        velocity_gain=(5.0, 5.0, 5.0, 5.0, 1.5, 1.5),
        damping=(0.2,) * 6,
        frictionloss=(0.3,) * 6,
        armature=(0.005,) * 6,
        mass_scale=(1.0,) * 6,
    )
    return dataclasses.replace(published, **changes)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build(physics(), 0.002)


def test_masses(model: mujoco.MjModel) -> None:
    assert model.body("base").mass[0] == pytest.approx(BASE)
    for i, (*_, mass, _) in enumerate(R5A):
        assert model.body(f"link{i + 1}").mass[0] == pytest.approx(mass)
    assert model.body("gripper").mass[0] == pytest.approx(FINGERS)
    assert model.body_mass.sum() == pytest.approx(3.88996, abs=1e-5)


@pytest.mark.parametrize("q", POSES)
def test_frames(model: mujoco.MjModel, q: np.ndarray) -> None:
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    for i, (position, rotation) in enumerate(chain(q)):
        body = data.body(f"link{i + 1}")
        np.testing.assert_allclose(body.xpos, position, atol=2e-5)  # their π is 3.1416
        np.testing.assert_allclose(body.xmat.reshape(3, 3), rotation.as_matrix(), atol=5e-5)
    position, rotation = chain(q)[-1]
    tip = position + rotation.apply(FINGERS_AT)
    np.testing.assert_allclose(data.body("gripper").xpos, tip, atol=2e-5)
    np.testing.assert_allclose(data.body("gripper").xipos, data.body("gripper").xpos, atol=1e-12)


def test_limits_and_effort(model: mujoco.MjModel) -> None:
    published = {
        "joint1": (-2.618, 2.618),  # upper 2.168 in the file, which contradicts its mirror
        "joint2": (0, 3.66),
        "joint3": (0, 3.14),
        "joint4": (-1.57, 1.57),
        "joint5": (-1.57, 1.57),
        "joint6": (-1.57, 1.57),
    }
    assert [model.joint(j).name for j in range(model.njnt)] == list(published)
    for name, limits in published.items():
        np.testing.assert_allclose(model.joint(name).range, limits)
        np.testing.assert_allclose(model.actuator(name).forcerange, (-100, 100))
        assert model.joint(name).limited[0]
        assert model.actuator(name).trnid[0] == model.joint(name).id


def test_nothing_touches_and_drawings_weigh_nothing(model: mujoco.MjModel) -> None:
    assert model.ngeom >= 8
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    assert model.opt.timestep == 0.002


def test_every_number_arrives() -> None:
    rows = [tuple(10.0 * k + i + 1 for i in range(6)) for k in range(5)]
    scale = (1.1, 1.2, 1.3, 1.4, 1.5, 1.6)
    model = build(ArmPhysics(*rows, mass_scale=scale), 0.004)
    plain = build(physics(), 0.004)
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], rows[0])
    np.testing.assert_allclose(model.actuator_biasprm[:, 1], -np.array(rows[0]))
    np.testing.assert_allclose(model.actuator_biasprm[:, 2], -np.array(rows[1]))
    np.testing.assert_allclose(model.dof_damping, rows[2])
    np.testing.assert_allclose(model.dof_frictionloss, rows[3])
    np.testing.assert_allclose(model.dof_armature, rows[4])
    factor = np.array([*scale, scale[-1]])  # the fingers go with the wrist
    links = slice(plain.body("link1").id, None)
    np.testing.assert_allclose(model.body_mass[links] / plain.body_mass[links], factor)
    ratio = model.body_inertia[links] / plain.body_inertia[links]
    np.testing.assert_allclose(ratio, np.repeat(factor[:, None], 3, axis=1))
    np.testing.assert_allclose(model.body_ipos, plain.body_ipos)


@pytest.mark.parametrize("factor", [1.0, 1.35])
def test_servos_hold_the_weight_at_rest(factor: float) -> None:
    """At rest stiffness · (target - q) is the gradient of the potential energy."""
    kp = np.array((60.0, 70.0, 80.0, 40.0, 10.0, 10.0))
    model = build(
        physics(stiffness=tuple(kp), frictionloss=(0.0,) * 6, mass_scale=(factor,) * 6), 0.002
    )
    data = mujoco.MjData(model)
    target = np.array([0.3, 1.2, 1.0, 0.2, 0.4, 0.2])
    data.qpos[:], data.ctrl[:] = target, target
    mujoco.mj_step(model, data, 3000)
    assert np.abs(data.qvel).max() < 1e-6
    q, eps = data.qpos.copy(), 1e-6
    torque = [(potential(q + d) - potential(q - d)) / (2 * eps) for d in eps * np.eye(6)]
    np.testing.assert_allclose(kp * (target - q), factor * np.array(torque), atol=2e-3)
    assert np.abs(torque).max() > 2  # a pose where weight matters


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("stiffness", (80.0, 80.0)),
        ("damping", (0.2, 0.2, 0.2, -0.2, 0.2, 0.2)),
        ("mass_scale", (1.0, 1.0, 1.0, 1.0, 1.0, 0.0)),
        ("armature", (float("nan"),) * 6),
    ],
)
def test_refuses_impossible_arms(name: str, values: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=name):
        physics(**{name: values})


def test_agrees_with_the_published_mjcf(model: mujoco.MjModel, from_shared: FromShared) -> None:
    file = from_shared("models/arx/menagerie_arx_l5_trimmed.xml")
    theirs = mujoco.MjModel.from_xml_path(str(file))
    link5 = theirs.body("link5").id
    assert theirs.body_pos[link5, 0] == pytest.approx(0.073914)
    theirs.body_pos[link5, 0] = 0.0702  # the one frame in which L5 and R5a differ
    a, b = mujoco.MjData(model), mujoco.MjData(theirs)
    rng = np.random.default_rng(0)
    names = [f"link{i}" for i in range(1, 7)]
    for _ in range(5):
        a.qpos[:] = rng.uniform(*model.jnt_range.T)
        b.qpos[:6] = a.qpos
        mujoco.mj_kinematics(model, a)
        mujoco.mj_kinematics(theirs, b)
        for name in names:
            np.testing.assert_allclose(a.body(name).xpos, b.body(name).xpos, atol=1e-5)
            np.testing.assert_allclose(a.body(name).xmat, b.body(name).xmat, atol=2e-5)
            np.testing.assert_allclose(a.body(name).xipos, b.body(name).xipos, atol=1e-5)
    for name in names:
        ours, other = model.body(name), theirs.body(name)
        assert ours.mass[0] == pytest.approx(other.mass[0])
        np.testing.assert_allclose(ours.inertia, other.inertia)
        np.testing.assert_allclose(ours.iquat, other.iquat, atol=1e-6)
    fingers = theirs.body("link7").mass[0] + theirs.body("link8").mass[0]
    assert model.body("gripper").mass[0] == pytest.approx(fingers, rel=1e-5)
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], theirs.actuator_gainprm[:6, 0])
    np.testing.assert_allclose(model.actuator_biasprm[:, 2], theirs.actuator_biasprm[:6, 2])


def test_agrees_with_the_makers_description(model: mujoco.MjModel, from_shared: FromShared) -> None:
    robot = ET.parse(from_shared("models/arx/R5a.urdf")).getroot()
    for i in range(1, 7):
        joint = robot.find(f"joint[@name='joint{i}']")
        link = robot.find(f"link[@name='link{i}']/inertial")
        assert joint is not None and link is not None
        body = model.body(f"link{i}")
        np.testing.assert_allclose(body.pos, numbers(joint, "origin", "xyz"), atol=1e-9)
        np.testing.assert_allclose(model.joint(f"joint{i}").axis, numbers(joint, "axis", "xyz"))
        low, high = numbers(joint, "limit", "lower")[0], numbers(joint, "limit", "upper")[0]
        assert model.joint(f"joint{i}").range[0] == low
        assert model.joint(f"joint{i}").range[1] == (2.618 if i == 1 else high)
        assert body.mass[0] == numbers(link, "mass", "value")[0]
        np.testing.assert_allclose(body.ipos, numbers(link, "origin", "xyz"), atol=1e-9)
        turn = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
        xx, yy, zz, xy, xz, yz = (
            numbers(link, "inertia", k)[0] for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        np.testing.assert_allclose(turn @ np.diag(body.inertia) @ turn.T, tensor, atol=2e-5)


def numbers(element: ET.Element, tag: str, attribute: str) -> list[float]:
    found = element.find(tag)
    assert found is not None
    return [float(x) for x in found.attrib[attribute].split()]
