"""A machine's model, and what is replayed on it, for another process or another computer."""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cloudpickle
import mujoco

from wt.physics.effect import effects
from wt.physics.rollout import Replayer
from wt.physics.runner import Divisible, Hypotheses
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


def packed(replays: Divisible) -> bytes:
    """What is replayed on a scene, without the scene; for :func:`unpacked`."""
    return _dumped((replays.stretches, replays.step), replays.scene)


def unpacked(scene: Scene, rest: bytes) -> Replayer:
    """The replays that :func:`packed` was given, on the scene as it is here."""
    return Replayer(scene, *_loaded(rest, scene))


def told(replays: Divisible, hypotheses: Hypotheses) -> bytes:
    """Hypotheses, without scene, recordings and effects that they refer to; for :func:`heard`."""
    return _dumped(hypotheses, *_known(replays))


def heard(replays: Divisible, hypotheses: bytes) -> Hypotheses:
    """What :func:`told` was given, of the scene and recordings as they are here."""
    loaded: Hypotheses = _loaded(hypotheses, *_known(replays))
    return loaded


def _known(replays: Divisible) -> list[object]:
    """What is here and there alike: an effect stays the same one, by which replays are known."""
    return [replays.scene, replays.stretches[0].motion, *effects().values()]


def _dumped(thing: object, *known: object) -> bytes:
    """Pickle what refers to things that are known where it goes, without these."""
    file = io.BytesIO()
    _Pickler(file, known).dump(thing)
    return file.getvalue()


def _loaded(data: bytes, *known: object) -> Any:  # noqa: ANN401 – whatever was pickled
    """What :func:`_dumped` made, referring to what is known here, in the same order."""
    return _Unpickler(io.BytesIO(data), known).load()


class _Pickler(cloudpickle.Pickler):
    def __init__(self, file: io.BytesIO, known: tuple[object, ...]) -> None:
        super().__init__(file)
        self._known = {id(thing): i for i, thing in enumerate(known) if thing is not None}

    def persistent_id(self, thing: object) -> int | None:
        return self._known.get(id(thing))


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, known: tuple[object, ...]) -> None:
        super().__init__(file)
        self._known = known

    def persistent_load(self, index: int) -> object:
        return self._known[index]
