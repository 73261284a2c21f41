"""NumPy archives: one array a column, or one array a kind with names beside it.

What is taken, and the map: :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import ClassVar

import numpy as np

from wt.data.importers import _arrays
from wt.data.importers.base import Map, register
from wt.errors import DataError
from wt.types import Recording


@register
class Npz:
    """Reads one archive."""

    name: ClassVar[str] = "npz"
    about: ClassVar[str] = "a NumPy .npz archive"
    keys: ClassVar[frozenset[str]] = _arrays.KEYS
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is an archive by its name."""
        return path.is_file() and path.suffix.lower() == ".npz"

    def read(self, path: Path, mapping: Map) -> Recording:
        """The arrays as a recording.

        Raises:
            DataError: it is no whole archive, or an array is missing or has another shape.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise DataError(
                f"'{path}' is not a whole archive of plain arrays (cut off, or with Python "
                f"objects inside?): {error}"
            ) from error
        return _arrays.recording(path, arrays, mapping, self.name)
