"""HDF5 files (``.h5``, ``.hdf5``): ALOHA, robomimic and Isaac Lab, and any other by a map.

An array goes by its path (``observations/qpos``). Where episodes stand as ``data/demo_0``, …, as
robomimic and Isaac Lab have it, paths begin inside of the episode. Only arrays that are asked for
are read; links to other files, and arrays that are kept outside of the file, are refused.

Map::

    episode: 3       # needed where there are several

What is taken, and the rest of the map: :mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Shaped

from wt.data import recording as recordings
from wt.data.importers import _arrays, _mapping
from wt.data.importers._survey import Survey
from wt.data.importers.base import Map, register
from wt.errors import DataError, WTError
from wt.types import Recording

if TYPE_CHECKING:
    import h5py

_DEMO = re.compile(r"data/demo_(\d+)")
_MOST_LINKS = 100_000


@register
class Hdf5:
    """Reads one episode."""

    name: ClassVar[str] = "hdf5"
    about: ClassVar[str] = "an .h5 or .hdf5 file"
    keys: ClassVar[frozenset[str]] = _arrays.KEYS | {"episode"}
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file by its name."""
        return path.is_file() and path.suffix.lower() in (".h5", ".hdf5")

    def read(self, path: Path, mapping: Map) -> Recording:
        """The arrays of a file, or of one of its episodes, as a recording.

        Raises:
            DataError: it is no whole file, or the map does not fit it.
        """
        with opened(path) as file:
            arrays = _episode(path, datasets(path, file), mapping.get("episode"))
            return _arrays.recording(path, arrays, mapping, self.name, lambda: _rate(path, file))

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The rows of numbers in a file, or in one of its episodes.

        Raises:
            DataError: it is no whole file.
        """
        with opened(path) as file:
            arrays = _episode(path, datasets(path, file), mapping.get("episode"))
            found = _arrays.survey({n: arrays[n] for n in arrays if arrays.is_table(n)})
            return Survey(found.quantities, rate_hz=found.rate_hz or _rate(path, file))


class Datasets(Mapping[str, Shaped[np.ndarray, " ..."]]):
    """Arrays of an open file by path, read when they are asked for."""

    def __init__(self, path: Path, by_name: Mapping[str, h5py.Dataset]) -> None:
        """Arrays ``by_name`` of the file ``path``."""
        self._path, self._by_name = path, by_name

    def __getitem__(self, name: str) -> Shaped[np.ndarray, " ..."]:
        """One array, read whole."""
        dataset = self._by_name[name]
        recordings.refuse_too_much(self._path, dataset.size * dataset.dtype.itemsize)
        if dataset.dtype.kind in "OS":
            return np.array(_words(self._path, dataset.name), dtype=np.str_)
        return np.asarray(dataset[()])

    def __iter__(self) -> Iterator[str]:
        """Paths in the file's order."""
        return iter(self._by_name)

    def __len__(self) -> int:
        """Number of arrays."""
        return len(self._by_name)

    def is_table(self, name: str) -> bool:
        """True for numbers in one or two dimensions."""
        dataset = self._by_name[name]
        return dataset.dtype.kind in "fiub" and 1 <= len(dataset.shape) <= 2

    def under(self, prefix: str) -> Datasets:
        """Those below a group, by their paths in it."""
        inside = {
            n.removeprefix(prefix): d for n, d in self._by_name.items() if n.startswith(prefix)
        }
        return Datasets(self._path, inside)


_WORDS = """
import h5py, json, numpy, sys
path, name, attribute = sys.argv[1:]
with h5py.File(path, "r") as file:
    found = file[name].attrs[attribute] if attribute else file[name][()]
words = [w.decode("utf-8", "replace") if isinstance(w, bytes) else w for w in numpy.ravel(found)]
print(json.dumps([w for w in words if isinstance(w, str)]))
"""
_PATIENCE_S = 8


def _words(path: Path, name: str, attribute: str = "") -> list[str]:
    """Words in an array or an attribute.

    They are read in a process that can be ended: where a file is damaged, the library may look for
    them for ever.

    Raises:
        DataError: they cannot be read.
    """
    command = [sys.executable, "-I", "-c", _WORDS, str(path), name, attribute]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_PATIENCE_S, check=True
        )
        return [str(word) for word in json.loads(done.stdout)]
    except (subprocess.SubprocessError, OSError, ValueError) as error:
        raise DataError(
            f"'{path}' is not a whole HDF5 file: the words in {attribute or name!r} cannot be read"
        ) from error


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to read in.

    Raises:
        DataError: whatever goes wrong while it is read, as one line.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            yield file
    except WTError:
        raise
    except Exception as error:  # the library lets through whatever broken bytes make it raise
        said = str(error).strip("'\" ").splitlines() or [type(error).__name__]
        raise DataError(f"'{path}' is not a whole HDF5 file: {said[0]}") from error


def datasets(path: Path, file: h5py.File) -> Datasets:
    """All arrays of a file.

    Raises:
        DataError: it links to other files.
    """
    import h5py

    names: list[str] = []
    out: list[tuple[str, str]] = []

    # the library cannot be left by an exception here: what is returned ends the visit
    def seen(name: str, link: object) -> bool | None:
        names.append(name)
        if isinstance(link, h5py.ExternalLink):
            out.append((name, link.filename))
        return True if out or len(names) > _MOST_LINKS else None

    file.visititems_links(seen)
    if out:
        raise DataError(
            f"'{path}': {out[0][0]!r} is a link into another file, {out[0][1]!r}; copy it in "
            "(h5py's copy with expand_external=True)"
        )
    if len(names) > _MOST_LINKS:
        raise DataError(f"'{path}' has more than {_MOST_LINKS} arrays; split it")
    items = {name: file.get(name) for name in names}
    found = {name: item for name, item in items.items() if isinstance(item, h5py.Dataset)}
    for name, item in found.items():
        if item.external or item.is_virtual:
            raise DataError(f"'{path}': array {name!r} is kept in other files; copy it in")
    return Datasets(path, found)


def _episode(path: Path, arrays: Datasets, wanted: object) -> Datasets:
    """The arrays of one episode, or all where there are no episodes."""
    numbers = sorted({int(m[1]) for name in arrays if (m := _DEMO.match(name))})
    if not numbers:
        if wanted is not None:
            raise DataError(f"'{path}' has no episodes data/demo_<N>; leave 'episode' out")
        return arrays
    return arrays.under(f"data/demo_{_mapping.episode(path, numbers, wanted)}/")


def _rate(path: Path, file: h5py.File) -> float | None:
    """Control rate of robosuite [Hz], which robomimic keeps in the metadata of ``data``."""
    if "data" not in file or "env_args" not in file["data"].attrs:
        return None
    try:
        (text,) = _words(path, "data", "env_args")
        return float(json.loads(text)["env_kwargs"]["control_freq"])
    except (TypeError, ValueError, KeyError, RecursionError):
        return None
