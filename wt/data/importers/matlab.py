"""MATLAB files (``.mat``): one array a variable, cells as ``variable/0``, ….

Files of version 7.3 need the package h5py, and their cells are left out. Columns of one value are
flat arrays here, and tables that are wider than long are turned over: time goes down. Beyond that
see :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import scipy.io
from jaxtyping import Shaped

from wt.data import recording as recordings
from wt.data.importers import hdf5
from wt.data.importers._arrays import ArrayImporter, Arrays
from wt.data.importers.base import register
from wt.errors import DataError, WTError


@register
class Matlab(ArrayImporter):
    """Reads one file."""

    name: ClassVar[str] = "matlab"
    about: ClassVar[str] = "a MATLAB .mat file"
    suffixes: ClassVar[tuple[str, ...]] = (".mat",)

    def arrays(self, path: Path) -> Arrays:
        """See :class:`ArrayImporter`."""
        try:
            if scipy.io.matlab.matfile_version(path)[0] > 1:
                return _read_hdf5(path)
            sizes = [math.prod(shape) for _, shape, _ in scipy.io.whosmat(path)]
            recordings.refuse_too_much(path, 8 * sum(sizes))
            content = scipy.io.loadmat(path)
        except (WTError, ModuleNotFoundError):
            raise
        except Exception as error:  # the reader lets through whatever a broken file makes it raise
            raise DataError(f"'{path}' is not a whole MATLAB file: {error}") from error
        variables = {n: v for n, v in content.items() if isinstance(v, np.ndarray)}
        return dict(pair for n, v in variables.items() for pair in _flat(n, v))


def _read_hdf5(path: Path) -> dict[str, Shaped[np.ndarray, " ..."]]:
    """The numbers of a file of version 7.3, which is HDF5 with every array turned over."""
    with hdf5.opened(path) as file:
        found = hdf5.datasets(path, file)
        tables = {n: found[n] for n in found if found.is_table(n) and not n.startswith("#")}
    return dict(pair for n, v in tables.items() for pair in _flat(n, v.T))


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
