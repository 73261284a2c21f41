"""ROS 2 bags: folders with metadata.yaml, and their .db3 files alone.

What is read, and the map: :mod:`wt.data.importers._topics`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from wt.data.importers import _topics
from wt.data.importers._messages import Raw, ros_decoders
from wt.data.importers._survey import Survey
from wt.data.importers.base import Map, register
from wt.types import Recording


@register
class Ros2:
    """Reads one recording."""

    name: ClassVar[str] = "ros2"
    about: ClassVar[str] = "a .db3 file of ROS 2, or a bag folder with metadata.yaml"
    keys: ClassVar[frozenset[str]] = _topics.KEYS
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file or folder by its name."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.is_file() and path.suffix == ".db3"

    def read(self, path: Path, mapping: Map) -> Recording:
        """The topics as a recording.

        Raises:
            DataError: the file is broken, has no known topic, or the map does not fit it.
        """
        return _topics.recording(path, _raws(path), mapping, self.name)

    def survey(self, path: Path, mapping: Map) -> Survey:
        """The numbers of all topics.

        Raises:
            DataError: the file is broken.
        """
        return _topics.survey(path, _raws(path))


def _raws(path: Path) -> Iterator[Raw]:
    from rosbags.rosbag2 import Reader

    decoder = ros_decoders(2)
    with Reader(path) as reader:
        decoders = {c.id: decoder(c.msgtype, c.msgdef.data) for c in reader.connections}
        for connection, logged, data in reader.messages():
            decode = decoders[connection.id]
            yield Raw(connection.topic, connection.msgtype, "cdr", logged, bytes(data), decode)
