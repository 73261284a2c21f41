"""For the site alone, which has no code beside it: links to files of the repository are text."""

from __future__ import annotations

import re
from typing import Any

_INTO_CODE = re.compile(r"\[([^\]]+)\]\(\.\./[^)]+\)")


def on_page_markdown(markdown: str, **_: Any) -> str:  # noqa: ANN401 – what MkDocs passes
    """A page without such links."""
    return _INTO_CODE.sub(r"\1", markdown)
