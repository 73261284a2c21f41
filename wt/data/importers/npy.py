"""One NumPy array in a ``.npy`` file: a table, or one with named fields (a structured array).

A table is the array ``data``, with the map's ``index`` for its columns; fields go by their names.
What is taken, and the map: :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Shaped

from wt.data import recording as recordings
from wt.data.importers import _arrays
from wt.data.importers._survey import Survey
from wt.data.importers.base import Map, register
from wt.errors import DataError
from wt.types import Recording


@register
class Npy:
    """Reads one array."""

    name: ClassVar[str] = "npy"
    about: ClassVar[str] = "a NumPy .npy array"
    keys: ClassVar[frozenset[str]] = _arrays.KEYS
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is an array by its name."""
        return path.is_file() and path.suffix.lower() == ".npy"

    def read(self, path: Path, mapping: Map) -> Recording:
        """The array as a recording.

        Raises:
            DataError: it is no whole array of numbers, or the map does not fit it.
        """
        return _arrays.recording(path, _read(path), mapping, self.name)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The array's columns.

        Raises:
            DataError: it is no whole array of numbers.
        """
        return _arrays.survey(_read(path))


def _read(path: Path) -> dict[str, Shaped[np.ndarray, " ..."]]:
    recordings.refuse_too_much(path, path.stat().st_size)
    try:
        # mapped: a header that promises more than the file has is refused before anything is read
        array = np.load(path, allow_pickle=False, mmap_mode="r")
        if not isinstance(array, np.ndarray):
            raise ValueError("it is an archive")
        if array.dtype.names is not None:
            return {name: np.array(array[name]) for name in array.dtype.names}
        return {"data": np.array(array)}
    except Exception as error:  # the reader lets through whatever a broken file makes it raise
        raise DataError(
            f"'{path}' is not a whole array of plain numbers (cut off, or with Python objects "
            f"inside?): {error}"
        ) from error
