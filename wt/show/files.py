"""Write files so that each is either the earlier one or the whole new one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Write to a temporary name beside ``path`` and rename it when whole.

    Raises:
        OSError: the disk is full or the folder cannot be written; an earlier file is intact.
    """
    write_together(path.parent, {path.name: content})


def write_together(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write several files into a folder; the first is renamed when the last is whole.

    Args:
        folder: where they go; it exists.
        contents: what to write, by file name.

    Raises:
        OSError: the disk is full or the folder cannot be written; earlier files are intact.
    """
    parts = {name: folder / f".{name}.part" for name in contents}
    try:
        for name, content in contents.items():
            parts[name].write_bytes(content.encode() if isinstance(content, str) else content)
        for name, part in parts.items():
            os.replace(part, folder / name)
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)
