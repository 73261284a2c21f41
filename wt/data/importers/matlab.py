"""MATLAB files (``.mat`` up to version 7): one array a variable, cells as ``variable/0``, ….

Columns of one value are flat arrays here, and tables that are wider than long are turned over:
time goes down. Beyond that see :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import scipy.io
from jaxtyping import Shaped

from wt.data.importers import _arrays
from wt.data.importers.base import Map, register
from wt.errors import DataError
from wt.types import Recording


@register
class Matlab:
    """Reads one file."""

    name: ClassVar[str] = "matlab"
    about: ClassVar[str] = "a MATLAB .mat file"
    keys: ClassVar[frozenset[str]] = _arrays.KEYS
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file by its name."""
        return path.is_file() and path.suffix.lower() == ".mat"

    def read(self, path: Path, mapping: Map) -> Recording:
        """The variables as a recording.

        Raises:
            DataError: it is no whole file of a version that can be read, or a variable is missing
                or has another shape.
        """
        try:
            content = scipy.io.loadmat(path)
        except NotImplementedError as error:
            raise DataError(
                f"'{path}' is of MATLAB's version 7.3; save it with save(…, '-v7')"
            ) from error
        except (ValueError, TypeError, OSError, EOFError) as error:
            raise DataError(f"'{path}' is not a whole MATLAB file: {error}") from error
        variables = {n: v for n, v in content.items() if isinstance(v, np.ndarray)}
        arrays = dict(pair for n, v in variables.items() for pair in _flat(n, v))
        return _arrays.recording(path, arrays, mapping, self.name)


def _flat(
    name: str, value: Shaped[np.ndarray, " ..."]
) -> Iterator[tuple[str, Shaped[np.ndarray, " ..."]]]:
    """A variable with time down, or each cell of it."""
    if value.dtype == object:
        for i, cell in enumerate(value.ravel()):
            yield from _flat(f"{name}/{i}", np.asarray(cell))
    elif value.ndim == 2:
        turned = value.T if value.shape[1] > value.shape[0] else value
        yield name, turned[:, 0] if turned.shape[1] == 1 else turned
    else:
        yield name, value
