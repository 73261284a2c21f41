"""Bags of ROS 1: ``.bag`` files.

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
class Ros1:
    """Reads one bag."""

    name: ClassVar[str] = "ros1"
    about: ClassVar[str] = "a .bag file of ROS 1"
    keys: ClassVar[frozenset[str]] = _topics.KEYS
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is a bag by its name."""
        return path.is_file() and path.suffix == ".bag"

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
    from rosbags.rosbag1 import Reader

    decoder = ros_decoders(1)
    with Reader(path) as reader:
        decoders = {c.id: decoder(c.msgtype, c.msgdef.data) for c in reader.connections}
        for connection, logged, data in reader.messages():
            decode = decoders[connection.id]
            yield Raw(connection.topic, connection.msgtype, "ros1", logged, bytes(data), decode)
