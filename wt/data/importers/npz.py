"""NumPy archives: one array a column, or one array a kind with names beside it.

What is taken, and the map: :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import ClassVar

import numpy as np

from wt.data import recording as recordings
from wt.data.importers._arrays import ArrayImporter, Arrays
from wt.data.importers.base import register
from wt.errors import DataError, WTError


@register
class Npz(ArrayImporter):
    """Reads one archive."""

    name: ClassVar[str] = "npz"
    about: ClassVar[str] = "a NumPy .npz archive"
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def arrays(self, path: Path) -> Arrays:
        """See :class:`ArrayImporter`."""
        try:
            with zipfile.ZipFile(path) as archive:
                recordings.refuse_too_much(path, sum(info.file_size for info in archive.infolist()))
            with np.load(path, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except WTError:
            raise
        except Exception as error:  # readers let through whatever a broken file makes them raise
            raise DataError(
                f"'{path}' is not a whole archive of plain arrays (cut off, or with Python "
                f"objects inside?): {error}"
            ) from error
