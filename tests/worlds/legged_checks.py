"""What the tests of the legged models share: the published files, and comparisons with them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from wt.worlds.legged_model import STAND


def published(file: Path) -> mujoco.MjModel:
    """A published model without its meshes."""
    root = ET.parse(file).getroot()
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag == "mesh" or (child.tag == "geom" and "mesh" in child.attrib):
                parent.remove(child)  # inertials are explicit: nothing is lost
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def hinges(model: mujoco.MjModel) -> list[str]:
    """Names of the joints after the free one, in order."""
    free = mujoco.mjtJoint.mjJNT_FREE
    return [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] != free]


def random_poses(model: mujoco.MjModel, count: int, seed: int) -> np.ndarray:
    """Poses ``qpos`` with the base anywhere and the hinges within their limits."""
    rng = np.random.default_rng(seed)
    low, high = model.jnt_range[1:].T
    poses = np.empty((count, model.nq))
    poses[:, :3] = rng.normal(size=(count, 3))
    quats = rng.normal(size=(count, 4))
    poses[:, 3:7] = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    poses[:, 7:] = rng.uniform(low, high, size=(count, low.size))
    return poses


def same_dynamics(
    ours: mujoco.MjModel, theirs: mujoco.MjModel, feet: Mapping[str, np.ndarray], seed: int
) -> None:
    """Compare mass matrix, bias and Jacobians of points on bodies, over 20 poses.

    Args:
        ours: our model, without payload.
        theirs: the published one, of any rotor inertia: what it adds is taken off both.
        feet: a point in the frame of each body that is to be compared [m].
        seed: of the poses.
    """
    assert hinges(ours) == hinges(theirs)
    speeds = np.random.default_rng(seed + 1).normal(size=(20, ours.nv))
    for pose, speed in zip(random_poses(ours, 20, seed), speeds, strict=True):
        found = [_dynamics(model, pose, speed, feet) for model in (ours, theirs)]
        for a, b in zip(*found, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6 * np.abs(b).max())


def _dynamics(
    model: mujoco.MjModel, pose: np.ndarray, speed: np.ndarray, feet: Mapping[str, np.ndarray]
) -> list[np.ndarray]:
    data = mujoco.MjData(model)
    data.qpos, data.qvel = pose, speed
    mujoco.mj_forward(model, data)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    found = [mass - np.diag(model.dof_armature), data.qfrc_bias.copy()]
    for name, point in feet.items():
        body = data.body(name)
        at = body.xpos + body.xmat.reshape(3, 3) @ point
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jac(model, data, linear, angular, at, body.id)
        found += [at, linear, angular]
    return found


def same_inertials(ours: mujoco.MjModel, theirs: mujoco.MjModel, names: Mapping[str, str]) -> None:
    """Compare mass, centre of mass, inertia tensor and frame of each body.

    Args:
        ours: our model.
        theirs: the published one.
        names: our name of each body, and theirs.
    """
    for mine, other in names.items():
        a, b = ours.body(mine), theirs.body(other)
        np.testing.assert_allclose(a.mass, b.mass, rtol=1e-9)
        np.testing.assert_allclose(a.ipos, b.ipos, atol=1e-12)
        wanted = _tensor(b.iquat, b.inertia)
        np.testing.assert_allclose(_tensor(a.iquat, a.inertia), wanted, rtol=1e-6, atol=1e-9)
        if a.id > 1:  # where the base starts is nobody's business
            np.testing.assert_allclose(a.pos, b.pos, atol=1e-12)
            np.testing.assert_allclose(a.quat, b.quat, atol=1e-12)


def _tensor(quat: np.ndarray, principal: np.ndarray) -> np.ndarray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    turn = matrix.reshape(3, 3)
    return turn @ np.diag(principal) @ turn.T


def standing(model: mujoco.MjModel) -> mujoco.MjData:
    """A simulation that starts in the keyframe ``stand``."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(STAND).id)
    mujoco.mj_forward(model, data)
    return data


def run(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    """Step on, and see that nothing exploded."""
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    assert not data.warning.number.any()
    assert np.isfinite(data.qpos).all()


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[str]:
    """Names of the robot's geoms in contact; a body's name for one without."""
    found = set()
    for pair in data.contact.geom:
        for geom in pair:
            body = model.geom_bodyid[geom]
            if body:
                found.add(model.geom(geom).name or model.body(body).name)
    return found


def upward(data: mujoco.MjData, body: str) -> float:
    """Cosine of a body's tilt."""
    return float(data.body(body).xmat[8])
