"""How a model is named: of the registry, by ``name@alias`` or ``name/version``, or by a folder."""

from __future__ import annotations

import re
from pathlib import Path

REFERENCE = re.compile(r"(?P<name>[\w.-]+)(?:@(?P<alias>[\w-]+)|/(?P<version>\d+))")


def is_folder(reference: str) -> bool:
    """Whether a model is named by a folder: what is there wins over a name of the registry."""
    return Path(reference).exists() or REFERENCE.fullmatch(reference) is None
