"""Surfaces of geoms against their volumes in closed form."""

from __future__ import annotations

import mujoco
import numpy as np

from wt.show.surfaces import MOST_FACES, surface


def test_surfaces_are_closed_and_have_the_geoms_volume() -> None:
    """By the divergence theorem, Σ of face centre · area vector / 3 is the volume if closed."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset><mesh name="tet" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset><worldbody>
        <geom type="sphere" size=".5" pos="1 2 3"/><geom type="box" size=".1 .2 .3" euler="9 8 7"/>
        <geom type="cylinder" size=".2 .3"/><geom type="capsule" size=".2 .3"/>
        <geom type="ellipsoid" size=".1 .2 .3"/><geom type="mesh" mesh="tet"/>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    exact = [np.pi / 6, 0.048, np.pi * 0.024, np.pi * (0.024 + 4 / 3 * 0.008), np.pi * 0.008, 1 / 6]
    for geom, volume in enumerate(exact):
        faces = surface(model, data, geom)
        one = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]) / 2
        two = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 0]) / 2
        np.testing.assert_allclose((one + two).sum(axis=0), 0.0, atol=1e-6)
        found = (one * faces[:, :3].mean(axis=1) + two * faces[:, [0, 2, 3]].mean(axis=1)).sum() / 3
        assert 0.93 * volume < found < 1.001 * volume, geom


def test_a_fine_mesh_becomes_a_coarse_hull() -> None:
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="ball")
    mesh.make_sphere(4)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ball")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert model.mesh_facenum[0] > MOST_FACES
    faces = surface(model, data, 0)
    assert len(faces) <= MOST_FACES
    areas = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]) / 2
    volume = (areas * faces[:, :3].mean(axis=1)).sum() / 3
    assert 0.9 * 4 / 3 * np.pi < volume < 4 / 3 * np.pi
