"""ROS 2 bags: folders with metadata.yaml, and their .db3 files alone.

What is read, and the map: :mod:`wt.data.importers._topics`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from wt.data.importers._messages import Raw, bag_messages, ros_decoders
from wt.data.importers._topics import TopicImporter
from wt.data.importers.base import register


@register
class Ros2(TopicImporter):
    """Reads one recording."""

    name: ClassVar[str] = "ros2"
    about: ClassVar[str] = "a .db3 file of ROS 2, or a bag folder with metadata.yaml"

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file or folder by its name."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.is_file() and path.suffix == ".db3"

    def messages(self, path: Path) -> Iterator[Raw]:
        """See :class:`TopicImporter`."""
        from rosbags.rosbag2 import Reader

        with Reader(path) as reader:
            yield from bag_messages(reader, ros_decoders(2), "cdr")
