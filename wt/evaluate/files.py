"""Write a file so that it is either the earlier one or the whole new one."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Write to a temporary name beside ``path`` and rename it when whole.

    Raises:
        OSError: the disk is full or the folder cannot be written; an earlier file is intact.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
