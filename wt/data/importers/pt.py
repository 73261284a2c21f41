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
from types import UnionType
from typing import ClassVar

import numpy as np
from jaxtyping import Shaped

from wt.data import recording as recordings
from wt.data.importers._arrays import ArrayImporter, Arrays
from wt.data.importers.base import register
from wt.errors import DataError, WTError

_DEEPEST = 8


@register
class Pt(ArrayImporter):
    """Reads one file."""

    name: ClassVar[str] = "pt"
    about: ClassVar[str] = "a .pt file of tensors"
    suffixes: ClassVar[tuple[str, ...]] = (".pt", ".pth")

    def arrays(self, path: Path) -> Arrays:
        """See :class:`ArrayImporter`."""
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
            return dict(_flat(path, "", content, 0))
        except WTError:
            raise
        except Exception as error:  # whatever broken bytes make the reader raise
            said = str(error).strip().splitlines() or [type(error).__name__]
            raise DataError(
                f"'{path}' is not a whole file of tensors alone (cut off, or with Python objects "
                f"inside? save a dict of tensors): {said[0]}"
            ) from error


def _flat(
    path: Path, name: str, value: object, depth: int
) -> Iterator[tuple[str, Shaped[np.ndarray, " ..."]]]:
    """Arrays by their names in nested dictionaries of the file ``path``."""
    import torch

    if depth > _DEEPEST:
        raise ValueError(f"its dictionaries are nested more than {_DEEPEST} deep")
    if isinstance(value, torch.Tensor):
        if value.layout == torch.strided and not value.is_quantized and not value.is_complex():
            # one number, repeated for ever, takes no room in a file
            recordings.refuse_too_much(path, 8 * value.numel())
            whole = value.detach()
            whole = whole.to(torch.float64) if whole.is_floating_point() else whole
            yield name or "data", whole.numpy()
    elif isinstance(value, bool | int | float):
        yield name, np.array([float(value)])
    elif _all(value, str):
        yield name, np.array(value)
    elif _all(value, bool | int | float):
        yield name or "data", np.array(value, dtype=np.float64)
    elif isinstance(value, dict | list | tuple):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in parts:
            yield from _flat(path, f"{name}/{key}" if name else str(key), inner, depth + 1)


def _all(value: object, kind: type | UnionType) -> bool:
    """Tell whether it is a list of one kind, and not empty."""
    return (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(x, kind) for x in value)
    )
