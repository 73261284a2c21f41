"""Irregular stepping blocks: a field of boxes of random heights on the floor, hidden from robots.

The boxes are static geoms of the world on the ground's contact bit. Their friction and impedance
are of no account, since the robots' geoms have priority. Around the origin nothing stands on the
floor, so that an episode can begin on flat ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from wt.errors import ConfigError
from wt.worlds.legged_model import GROUND

_DEPTH = 0.1  # m, how far a box reaches below the floor: no edge of it can be stepped under
_GREYS = (0.45, 0.85)  # of the lowest and the highest block


@dataclass(frozen=True)
class Blocks:
    """A square field of blocks.

    Attributes:
        block: side of a block and of its cell without the gap [m].
        gap: between neighbours [m].
        height: of the highest possible block; each is uniform between zero and this [m].
        extent: half the side of the field [m].
        flat: half the side of the flat patch around the origin [m].
        seed: of the heights.
    """

    block: float = 0.4
    gap: float = 0.01
    height: float = 0.08
    extent: float = 6.0
    flat: float = 0.6
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse blocks that are no blocks, and fields without any."""
        for name in ("block", "gap", "height", "extent", "flat"):
            value = getattr(self, name)
            if not 0 <= value < np.inf or (value == 0 and name in ("block", "extent")):
                raise ConfigError(f"blocks: {name} is {value} m; a length above zero is needed")
        if self.extent <= self.flat + self.block:
            raise ConfigError(
                f"blocks: a field of ±{self.extent} m has no room for blocks around a flat patch "
                f"of ±{self.flat} m; make extent larger"
            )

    @property
    def cell(self) -> float:
        """Distance of neighbouring centres [m]."""
        return self.block + self.gap

    @property
    def side(self) -> int:
        """Blocks along one side of the field."""
        return int(2 * self.extent / self.cell)

    def centers(self) -> Float[np.ndarray, " side"]:
        """Coordinates of the blocks' centres along either axis [m]."""
        return (np.arange(self.side) - (self.side - 1) / 2) * self.cell

    def tops(self) -> Float[np.ndarray, "side side"]:
        """Heights of the blocks over the floor [m], by place along x and y."""
        heights = np.random.default_rng(self.seed).uniform(0, self.height, (self.side, self.side))
        near = np.abs(self.centers()) - self.block / 2 < self.flat
        heights[np.ix_(near, near)] = 0.0
        return heights


def add_blocks(spec: mujoco.MjSpec, blocks: Blocks) -> None:
    """Add the boxes of a field to a world with a floor at height zero."""
    tops, centers = blocks.tops(), blocks.centers()
    for i, x in enumerate(centers):
        for j, y in enumerate(centers):
            top = float(tops[i, j])
            if top == 0:
                continue
            half = (top + _DEPTH) / 2
            grey = _GREYS[0] + (_GREYS[1] - _GREYS[0]) * top / blocks.height
            geom = spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX, pos=(x, y, top - half),
                size=(blocks.block / 2, blocks.block / 2, half), rgba=(grey, grey, grey, 1.0),
            )  # fmt: skip
            geom.contype, geom.conaffinity = GROUND, 0


class GroundHeights:
    """Height of the ground: for rewards, critics and starts, never for an actor."""

    def __init__(self, blocks: Blocks | None) -> None:
        """Look up the field's heights.

        Args:
            blocks: the field; None for flat ground.
        """
        self._blocks = blocks
        self._tops = None if blocks is None else blocks.tops()

    def height(
        self, x: Float[np.ndarray, "*place"], y: Float[np.ndarray, "*place"]
    ) -> Float[np.ndarray, "*place"] | float:
        """Height under places x, y [m]; a gap counts as the nearer block."""
        if self._blocks is None or self._tops is None:
            return 0.0
        side, cell = self._blocks.side, self._blocks.cell
        i, j = (np.floor(v / cell + side / 2).astype(int) for v in (x, y))
        inside = (i >= 0) & (i < side) & (j >= 0) & (j < side)
        heights: np.ndarray = self._tops[np.clip(i, 0, side - 1), np.clip(j, 0, side - 1)]
        return np.where(inside, heights, 0.0)
