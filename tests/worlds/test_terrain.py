"""Blocks stand where a ray meets them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from wt.errors import ConfigError
from wt.worlds.legged_model import GROUND, start
from wt.worlds.terrain import Blocks, GroundHeights, add_blocks

FIELD = Blocks(block=0.4, gap=0.02, height=0.08, extent=2.0, flat=0.5, seed=3)


def compiled(blocks: Blocks) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = start("field", 0.005, floor=True)
    add_blocks(spec, blocks)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_height_is_where_a_ray_from_above_ends() -> None:
    model, data = compiled(FIELD)
    ground = GroundHeights(FIELD)
    rng = np.random.default_rng(0)
    met = 0
    for x, y in rng.uniform(-2.5, 2.5, (300, 2)):
        offset = np.abs(np.array([x, y])[:, None] - FIELD.centers()).min(1)
        if offset.max() > FIELD.block / 2 - 1e-3 and np.abs([x, y]).max() < 2.1:
            continue  # in a gap or at an edge
        which = np.zeros(1, np.int32)
        distance = mujoco.mj_ray(
            model, data, np.array([x, y, 1.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, which
        )
        height = float(np.asarray(ground.height(np.array([x]), np.array([y])))[0])
        assert height == pytest.approx(1.0 - distance, abs=1e-9)
        met += height > 0
    assert met > 50


def test_the_middle_is_flat_and_the_rest_irregular() -> None:
    tops, centers = FIELD.tops(), FIELD.centers()
    inside = np.abs(centers) - FIELD.block / 2 < FIELD.flat
    assert not tops[np.ix_(inside, inside)].any()
    rest = tops[tops > 0]
    assert rest.max() <= FIELD.height and rest.std() > 0.2 * FIELD.height


def test_every_geom_is_ground() -> None:
    model, _ = compiled(FIELD)
    assert (model.geom_contype == GROUND).all() and not model.geom_conaffinity.any()


def test_the_seed_decides() -> None:
    other = Blocks(**{**vars(FIELD), "seed": 4})
    assert np.array_equal(FIELD.tops(), FIELD.tops())
    assert not np.array_equal(FIELD.tops(), other.tops())


def test_without_blocks_the_ground_is_at_zero() -> None:
    assert GroundHeights(None).height(np.ones(2), np.ones(2)) == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"block": 0.0}, "block is 0.0 m"),
        ({"height": -0.1}, "height is -0.1 m"),
        ({"extent": 0.5}, "has no room for blocks"),
    ],
)
def test_impossible_fields_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Blocks(**{**vars(FIELD), **change})
