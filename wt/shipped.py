"""What comes with the package and is no code: configurations and examples.

In a checkout they are the folders ``conf`` and ``examples`` beside the packages; an installed wheel
has them under ``share/world-translation`` of the environment.
"""

from __future__ import annotations

from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Literal

_DISTRIBUTION = "world-translation"
_CHECKOUT = Path(__file__).parents[1]


def folder(kind: Literal["conf", "examples"]) -> Path:
    """Where they are; a folder that does not exist if the package came without them."""
    if (_CHECKOUT / "pyproject.toml").is_file():  # in site-packages a neighbour's folder may be
        return _CHECKOUT / kind
    with suppress(metadata.PackageNotFoundError):
        for file in metadata.files(_DISTRIBUTION) or ():
            for place in Path(str(file.locate())).resolve().parents:
                if place.parts[-3:] == ("share", _DISTRIBUTION, kind):
                    return place
    return _CHECKOUT / kind


def configuration(path: Path) -> Path:
    """The file that ``--config`` names: the path itself, or a shipped one by its bare name.

    Args:
        path: as given; ``r5`` and ``r5.yaml`` are names where no such file is.
    """
    if path.exists() or len(path.parts) != 1 or path.suffix not in ("", ".yaml"):
        return path
    shipped = folder("conf") / f"{path.stem}.yaml"
    return shipped if shipped.is_file() else path
