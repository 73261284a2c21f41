"""A machine's model for another process, or another computer."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco

from wt.physics.scene import Amendment, Scene


@dataclass(frozen=True, eq=False)
class PackedScene:
    """An MJCF and all files that it takes in, by their full paths, and what is amended in it."""

    path: Path
    files: Mapping[Path, bytes]
    amendments: tuple[Amendment, ...]

    @classmethod
    def of(cls, scene: Scene) -> PackedScene:
        """Read the files that a scene is made of."""
        path = scene.path.resolve()
        files = {Path(p).resolve() for p in mujoco.mju_getXMLDependencies(str(path))}
        return cls(path, {p: p.read_bytes() for p in files}, scene.amendments)

    def unpacked(self, folder: Callable[[], Path]) -> Scene:
        """The scene, of the files where they were if the same are there, else of copies.

        Args:
            folder: makes a new folder for copies.
        """
        return Scene(self._path(folder), self.amendments)

    def _path(self, folder: Callable[[], Path]) -> Path:
        if all(p.is_file() and p.read_bytes() == data for p, data in self.files.items()):
            return self.path
        above, here = os.path.commonpath([p.parent for p in self.files]), folder()
        for path, data in self.files.items():
            copy = here / path.relative_to(above)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(data)
        return here / self.path.relative_to(above)
