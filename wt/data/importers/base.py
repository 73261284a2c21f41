"""What reads a foreign format: the contract of an importer, its registry, and how to add one.

Adding a format is one new file in this package and its test: define a class with the members of
:class:`Importer` and decorate it with ``@register``. The file is found by itself; a name used
twice is refused.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import yaml

from wt.errors import DataError, suggest
from wt.types import Recording

Map = Mapping[str, Any]
"""The content of ``--map F.yaml``; what it may say stands at each importer."""


@runtime_checkable
class Importer(Protocol):
    """One foreign format.

    Attributes:
        name: short name of the format, unique.
        about: what a source of this format looks like, for messages.
    """

    name: ClassVar[str]
    about: ClassVar[str]

    def recognises(self, path: Path) -> bool:
        """Whether ``path`` looks like this format; must be quick and never raise."""
        ...

    def read(self, path: Path, mapping: Map) -> Recording:
        """The recording in ``path``.

        Args:
            path: a file or folder that this importer recognises.
            mapping: how its names map to those of an MJCF; empty for the importer's own.

        Raises:
            DataError: the source is broken, or the map does not fit it.
            RecordingError: what was read is not a valid recording.
        """
        ...


ImporterFactory = Callable[[], Importer]
_IMPORTERS: dict[str, Importer] = {}


def register(factory: ImporterFactory) -> ImporterFactory:
    """Class decorator: make an importer available.

    Raises:
        DataError: two files claim the same name.
    """
    importer = factory()
    if importer.name in _IMPORTERS:
        raise DataError(
            f"importer {importer.name!r} is defined by both "
            f"{type(_IMPORTERS[importer.name]).__module__} and {factory.__module__}; rename one"
        )
    _IMPORTERS[importer.name] = importer
    return factory


def importers() -> Mapping[str, Importer]:
    """Every importer by name."""
    import wt.data.importers

    for module in pkgutil.iter_modules(wt.data.importers.__path__):
        importlib.import_module(f"wt.data.importers.{module.name}")
    return dict(_IMPORTERS)


def read(path: str | Path, mapping: Map | None = None) -> Recording:
    """Read a source of any known format.

    Args:
        path: a file or folder.
        mapping: content of the map file, see each importer.

    Raises:
        DataError: nothing there, no importer recognises it, or it is broken.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"'{path}' does not exist; give the file or folder to import")
    known = importers()
    for importer in known.values():
        if importer.recognises(path):
            return importer.read(path, mapping or {})
    about = "; ".join(f"{i.name}: {i.about}" for i in known.values())
    raise DataError(f"'{path}' is of no known format; known are {about}")


def read_map(path: str | Path) -> Map:
    """The content of a map file.

    Raises:
        DataError: it is missing or no YAML mapping.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise DataError(f"map '{path}' cannot be read as YAML: {error}") from error
    if not isinstance(content, Mapping):
        raise DataError(f"map '{path}' holds {type(content).__name__}; it must be 'key: value'")
    return content


def refuse_unknown_keys(mapping: Map, allowed: set[str]) -> None:
    """Refuse keys of a map that the importer does not know.

    Raises:
        DataError: naming the key and the nearest allowed one.
    """
    for key in mapping:
        if key not in allowed:
            raise DataError(f"map key {key!r} is not known: {suggest(str(key), allowed)}")
