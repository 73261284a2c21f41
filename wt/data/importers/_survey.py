"""What a source holds before anybody says what it means: rows of numbers, each under its name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

Entry = Mapping[str, Any]
"""How a map names a quantity of the source, as in ``columns: {qpos/hip: ENTRY}``."""


@dataclass(frozen=True)
class Quantity:
    """One row of numbers.

    Attributes:
        name: its name in the source, with the number of its column where a table has several.
        entry: how a map names it.
        values: as they stand; NaN where there is none.
    """

    name: str
    entry: Entry
    values: Float64[np.ndarray, " sample"]


@dataclass(frozen=True)
class Survey:
    """The rows of a source.

    Attributes:
        quantities: all that are numbers, in the source's order.
        timed: whether each comes with its times, so that a map names none.
        rate_hz: a rate that the source states, else None [Hz].
    """

    quantities: Sequence[Quantity]
    timed: bool = False
    rate_hz: float | None = None


@runtime_checkable
class Surveyor(Protocol):
    """An importer whose sources leave open what is what, and whose map has ``columns``."""

    def survey(self, path: Path, mapping: Mapping[str, Any]) -> Survey:
        """The rows of a source.

        Args:
            path: a file or folder that the importer recognises.
            mapping: what is known already, such as the episode.

        Raises:
            DataError: the source is broken.
        """
        ...
