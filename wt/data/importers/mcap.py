"""MCAP files of any writer: channels of ROS 2 (CDR), ROS 1, JSON and Protobuf.

What is read, and the map: :mod:`wt.data.importers._topics`; what counts as a JointState in JSON and
Protobuf: :mod:`wt.data.importers._messages`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from wt.data import recording as recordings
from wt.data.importers._messages import (
    Decoder,
    Raw,
    from_json,
    protobuf_decoder,
    ros_decoders,
)
from wt.data.importers._topics import TopicImporter
from wt.data.importers.base import register

if TYPE_CHECKING:
    from mcap.records import Channel, Schema


@register
class Mcap(TopicImporter):
    """Reads one file."""

    name: ClassVar[str] = "mcap"
    about: ClassVar[str] = "an .mcap file"

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file by its name."""
        return path.is_file() and path.suffix == ".mcap"

    def messages(self, path: Path) -> Iterator[Raw]:
        """See :class:`TopicImporter`."""
        # this reader takes files of any writer; that of rosbags wants a bag's profile
        from mcap.reader import make_reader

        ros = {"cdr": ros_decoders(2), "ros1": ros_decoders(1)}
        decoders: dict[int, Decoder | None] = {}

        def decoder(channel: Channel, schema: Schema | None) -> Decoder | None:
            encoding = channel.message_encoding
            if encoding == "json":
                return from_json
            if schema is None:
                return None
            if encoding == "protobuf" and schema.encoding == "protobuf":
                return protobuf_decoder(schema.data, schema.name)
            if encoding not in ros:
                return None
            text = schema.encoding in ("ros2msg", "ros1msg")
            return ros[encoding](_ros_type(schema), schema.data.decode() if text else "")

        with path.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            chunks = summary.chunk_indexes if summary else []
            largest = max((chunk.uncompressed_size for chunk in chunks), default=0)
            recordings.refuse_too_much(path, largest)
            for schema, channel, message in reader.iter_messages():
                if channel.id not in decoders:
                    decoders[channel.id] = decoder(channel, schema)
                ours = schema is not None and channel.message_encoding in ros
                type_ = _ros_type(schema) if schema and ours else schema.name if schema else "?"
                yield Raw(
                    channel.topic, type_, channel.message_encoding, message.log_time, message.data,
                    decoders[channel.id],
                )  # fmt: skip


def _ros_type(schema: Schema) -> str:
    """A type as ROS 2 writes it: ROS 1 has no ``msg`` in the middle."""
    package, _, name = schema.name.rpartition("/")
    return schema.name if package.endswith("/msg") or not package else f"{package}/msg/{name}"
