"""Which body carries a load: one that it is in, or that it is closer to than to the next ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics import stool
from wt.physics.effects._tools import carried, within_reach
from wt.physics.scene import Scene


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return stool.scene(tmp_path_factory.mktemp("stool"))


@pytest.mark.parametrize(
    ("body", "position", "within"),
    [
        ("trunk", (0.1, -0.05, 0.03), True),  # inside
        ("trunk", (0.0, 0.0, 0.3), True),  # on top
        ("trunk", (0.0, 0.0, 0.9), False),  # on a mast
        ("left_thigh", (0.0, 0.0, -0.1), True),
        ("left_thigh", (-0.18, -0.2, 0.03), False),  # in the middle of the trunk
        ("left_shank", (0.0, 0.0, -0.2), True),  # below the foot: nothing else is there
        ("left_thigh", (0.0, 0.0, -0.26), False),  # on the shank
    ],
)
def test_a_load_is_where_a_body_can_carry_it(
    machine: Scene, body: str, position: tuple[float, ...], within: bool
) -> None:
    assert within_reach(machine, body, np.array(position)) is within


def test_no_load_outweighs_the_machine_by_far(machine: Scene) -> None:
    whole = float(machine.model.body_mass.sum())
    assert carried(machine, "trunk", 9.0 * whole, np.array([0.0, 0.0, 0.1]))
    assert not carried(machine, "trunk", 11.0 * whole, np.array([0.0, 0.0, 0.1]))


def test_a_body_without_a_shape_may_carry_anything(tmp_path: Path) -> None:
    path = tmp_path / "bare.xml"
    path.write_text(
        """<mujoco><worldbody><body name="link"><joint name="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
        <actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
    )
    assert within_reach(Scene(path), "link", np.array([0.0, 0.0, 3.0]))
