"""NumPy archives: one array a column, or one array a kind with names beside it.

What is taken, and the map: :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Shaped

from wt.data import recording as recordings
from wt.data.importers import _arrays
from wt.data.importers._survey import Survey
from wt.data.importers.base import Map, register
from wt.errors import DataError, WTError
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
        return _arrays.recording(path, _read(path), mapping, self.name)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The rows of numbers in the archive.

        Raises:
            DataError: it is no whole archive.
        """
        return _arrays.survey(_read(path))


def _read(path: Path) -> dict[str, Shaped[np.ndarray, " ..."]]:
    try:
        with zipfile.ZipFile(path) as archive:
            recordings.refuse_too_much(path, sum(info.file_size for info in archive.infolist()))
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except WTError:
        raise
    except Exception as error:  # its readers let through whatever a broken file makes them raise
        raise DataError(
            f"'{path}' is not a whole archive of plain arrays (cut off, or with Python "
            f"objects inside?): {error}"
        ) from error
