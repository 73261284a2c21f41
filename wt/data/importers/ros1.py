"""Bags of ROS 1: ``.bag`` files.

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
class Ros1(TopicImporter):
    """Reads one bag."""

    name: ClassVar[str] = "ros1"
    about: ClassVar[str] = "a .bag file of ROS 1"

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is a bag by its name."""
        return path.is_file() and path.suffix == ".bag"

    def messages(self, path: Path) -> Iterator[Raw]:
        """See :class:`TopicImporter`."""
        from rosbags.rosbag1 import Reader

        with Reader(path) as reader:
            yield from bag_messages(reader, ros_decoders(1), "ros1")
