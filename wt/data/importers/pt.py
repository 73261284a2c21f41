"""Tensors that PyTorch saved (``.pt``, ``.pth``), such as those of PACE; needs the package torch.

Dictionaries are gone through with ``/`` between their keys, lists of words are names
(``joint_names``), lists of tensors ``name/0``, …. Nothing but tensors, numbers and words is ever
loaded: what would run code when unpickled is refused. What is taken, and the map:
:mod:`wt.data.importers._arrays`.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
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

_DEEPEST = 8


@register
class Pt:
    """Reads one file."""

    name: ClassVar[str] = "pt"
    about: ClassVar[str] = "a .pt file of tensors"
    keys: ClassVar[frozenset[str]] = _arrays.KEYS
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file by its name."""
        return path.is_file() and path.suffix.lower() in (".pt", ".pth")

    def read(self, path: Path, mapping: Map) -> Recording:
        """The tensors as a recording.

        Raises:
            DataError: it is no whole file of tensors, or the map does not fit it.
        """
        return _arrays.recording(path, _read(path), mapping, self.name)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The rows of numbers among the tensors.

        Raises:
            DataError: it is no whole file of tensors.
        """
        return _arrays.survey(_read(path))


def _read(path: Path) -> dict[str, Shaped[np.ndarray, " ..."]]:
    if not zipfile.is_zipfile(path):
        raise DataError(
            f"'{path}' is no file of torch.save since PyTorch 1.6 (cut off?); save it again"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            recordings.refuse_too_much(path, sum(info.file_size for info in archive.infolist()))
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError) as error:
        raise DataError(f"'{path}' is not a whole file of tensors: {error}") from error
    if any(name.endswith("constants.pkl") for name in names):
        raise DataError(f"'{path}' is a TorchScript program, no file of tensors; save tensors")
    import torch

    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        return dict(_flat("", content, 0))
    except Exception as error:  # whatever broken bytes make the reader raise
        said = str(error).strip().splitlines() or [type(error).__name__]
        raise DataError(
            f"'{path}' is not a whole file of tensors alone (cut off, or with Python objects "
            f"inside? save a dict of tensors): {said[0]}"
        ) from error


def _flat(name: str, value: object, depth: int) -> Iterator[tuple[str, Shaped[np.ndarray, " ..."]]]:
    """Arrays by their names in nested dictionaries."""
    import torch

    if depth > _DEEPEST:
        raise ValueError(f"its dictionaries are nested more than {_DEEPEST} deep")
    if isinstance(value, torch.Tensor):
        if value.layout == torch.strided and not value.is_quantized and not value.is_complex():
            whole = value.detach()
            whole = whole.to(torch.float64) if whole.is_floating_point() else whole
            yield name or "data", whole.numpy()
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{name}/{key}" if name else str(key), inner, depth + 1)
    elif isinstance(value, list | tuple):
        if value and all(isinstance(word, str) for word in value):
            yield name, np.array(value)
        elif value and all(isinstance(x, bool | int | float) for x in value):
            yield name or "data", np.array(value, dtype=np.float64)
        else:
            for i, inner in enumerate(value):
                yield from _flat(f"{name}/{i}" if name else str(i), inner, depth + 1)
    elif isinstance(value, bool | int | float):
        yield name, np.array([float(value)])
