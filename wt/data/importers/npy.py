"""One NumPy array in a ``.npy`` file: a table, or one with named fields (a structured array).

A table is the array ``data``, with the map's ``index`` for its columns; fields go by their names.
What is taken, and the map: :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from wt.data import recording as recordings
from wt.data.importers._arrays import ArrayImporter, Arrays
from wt.data.importers.base import register
from wt.errors import DataError


@register
class Npy(ArrayImporter):
    """Reads one array."""

    name: ClassVar[str] = "npy"
    about: ClassVar[str] = "a NumPy .npy array"
    suffixes: ClassVar[tuple[str, ...]] = (".npy",)

    def arrays(self, path: Path) -> Arrays:
        """See :class:`ArrayImporter`."""
        recordings.refuse_too_much(path, path.stat().st_size)
        try:
            # mapped: a header that promises more than there is is refused before anything is read
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
