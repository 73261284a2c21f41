"""A recording that is one already, to be read under other names, units or signs.

Keys that every format has (joints, channels, units, …) stand in
:mod:`wt.data.importers._mapping`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pyarrow as pa
import pyarrow.parquet as pq

from wt.data import recording as recordings
from wt.data.importers.base import Map, register
from wt.types import Recording


@register
class OwnRecording:
    """Reads one Parquet file of the recording format."""

    name: ClassVar[str] = "recording"
    about: ClassVar[str] = "a .parquet file with a column t: a recording already"
    keys: ClassVar[frozenset[str]] = frozenset()
    general: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is a Parquet file with a column of time."""
        if path.suffix.lower() != ".parquet" or not path.is_file():
            return False
        try:
            return "t" in pq.read_schema(path).names
        except (pa.ArrowException, OSError, ValueError):
            return False

    def read(self, path: Path, mapping: Map) -> Recording:
        """The recording as it stands; what it was made of before is kept as ``first_source``.

        Raises:
            RecordingError: it is no whole recording.
        """
        recording = recordings.read(path)
        meta = {**recording.meta, "source": path.name, "format": self.name}
        if "source" in recording.meta:
            meta.setdefault("first_source", recording.meta["source"])
        return replace(recording, meta=meta)
