"""The contract of an importer of a foreign format, its registry, and how to add one.

Adding a format is one new file in this package and its test: define a class with the members of
:class:`Importer` and decorate it with ``@register``. The file is found by itself; a name used
twice is refused. Names, units and signs that a map changes are no importer's concern: it gives
the source's names, and :mod:`wt.data.importers._mapping` does the rest. One whose sources leave
open what is what has a ``survey`` too (:mod:`wt.data.importers._survey`), for ``--guess``. Files
whose names start with an underscore hold what importers share.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import ClassVar, Protocol, runtime_checkable

import yaml

from wt.data.importers import _checks, _mapping
from wt.data.importers._mapping import UNITS as UNITS
from wt.data.importers._mapping import Map, refuse_unknown_keys
from wt.errors import DataError
from wt.types import Recording


@runtime_checkable
class Importer(Protocol):
    """One foreign format.

    Attributes:
        name: short name of the format, unique.
        about: what a source of this format looks like, for messages.
        keys: keys of a map that this importer reads itself, beyond the common ones; a common key
            among them is its own too.
        general: whether others that recognise the same source know it better.
    """

    name: ClassVar[str]
    about: ClassVar[str]
    keys: ClassVar[frozenset[str]]
    general: ClassVar[bool]

    def recognises(self, path: Path) -> bool:
        """True if ``path`` looks like this format; must be quick and never raise."""
        ...

    def read(self, path: Path, mapping: Map) -> Recording:
        """The recording in ``path``.

        Args:
            path: a file or folder that this importer recognises.
            mapping: those keys of the map that are this importer's own.

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
        mapping: content of the map file, see :mod:`wt.data.importers._mapping` and each importer.

    Raises:
        DataError: nothing there, no importer recognises it, it is broken, the map does not fit,
            or a column contradicts another in sign or unit.
        RecordingError: what was read is not a valid recording.
    """
    recording = mapped(path, mapping)
    refuse_contradictions(path, recording, mapping)
    return recording


def mapped(path: str | Path, mapping: Map | None = None) -> Recording:
    """The same, even where columns contradict each other: to be looked at.

    Raises:
        DataError: nothing there, no importer recognises it, it is broken, or the map does not fit.
        RecordingError: what was read is not a valid recording.
    """
    path, mapping = Path(path), mapping or {}
    importer = importer_of(path)
    refuse_unknown_keys(mapping, set(_mapping.KEYS | importer.keys))
    own = {key: value for key, value in mapping.items() if key in importer.keys}
    return _mapping.apply(importer.read(path, own), _common(importer, mapping))


def refuse_contradictions(path: str | Path, recording: Recording, mapping: Map | None) -> None:
    """Refuse a recording of which a column contradicts another in sign or unit.

    Args:
        path: what it was read from.
        recording: what :func:`mapped` gave.
        mapping: the map that it was read with.

    Raises:
        DataError: naming the column, and the entry of the map that settles it.
    """
    _checks.refuse_contradictions(recording, _common(importer_of(Path(path)), mapping or {}))


def _common(importer: Importer, mapping: Map) -> Map:
    return {key: value for key, value in mapping.items() if key not in importer.keys}


def doubts(recording: Recording, mapping: Map | None = None) -> list[str]:
    """Doubts about units or signs that look wrong without being impossible; a line each.

    Args:
        recording: what :func:`read` gave.
        mapping: the map that it was read with.
    """
    return _checks.doubts(recording, mapping or {})


def delays(recording: Recording) -> dict[str, float]:
    """Delay from a command to the force or motion that answers it, by actuator [s]."""
    return _checks.delays(recording)


def importer_of(path: Path) -> Importer:
    """The importer that knows a source best.

    Args:
        path: a file or folder.

    Raises:
        DataError: nothing is there, or no importer recognises it.
    """
    if not path.exists():
        raise DataError(f"'{path}' does not exist; give the file or folder to import")
    known = importers()
    fitting = [i for i in known.values() if i.recognises(path)]
    if not fitting and path.suffix.lower() == ".parquet" and path.is_file():
        fitting = [known["recording"]]  # which says what is wrong with it
    if not fitting:
        about = "; ".join(f"{i.name}: {i.about}" for i in known.values())
        raise DataError(f"'{path}' is of no known format; known are {about}")
    return min(fitting, key=lambda i: i.general)


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
