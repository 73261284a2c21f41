"""Replays on a Ray cluster.

Workers are given the model's files and the stretches once, and then hypotheses.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float

from wt.cluster import called_off, connected, cores, same_versions, versions
from wt.physics.packed import PackedScene, heard, packed, told, unpacked
from wt.physics.planted import Planted
from wt.physics.rollout import Replayer
from wt.physics.runner import Divisible, joined, split
from wt.physics.scene import Scene

if TYPE_CHECKING:
    from ray import ObjectRef


_KEPT = 40
"""Replayers that a worker keeps; a diagnosis uses a few at a time, of each limb of a machine."""


@contextmanager
def cluster() -> Iterator[Cluster]:
    """A Ray cluster for the block; what was started for it ends with it.

    Raises:
        UserError: Ray is not installed, or nothing answers at ``RAY_ADDRESS``.
        WorkError: Ray does not start on this machine.
    """
    with connected("jobs 'ray'"):
        yield Cluster()


@dataclass(frozen=True, eq=False)
class _Prepared:
    """The ingredients of a replayer: the scene, and stretches and step, which refer to it."""

    scene: ObjectRef
    rest: bytes


class Cluster:
    """Runs replays in Ray tasks of one thread each."""

    def __init__(self) -> None:
        """Use the cluster that this process is connected to."""
        import ray

        self._task = ray.remote(_replay)
        self._scenes: WeakKeyDictionary[Scene, ObjectRef] = WeakKeyDictionary()
        self._prepared: WeakKeyDictionary[Divisible, ObjectRef] = WeakKeyDictionary()

    def replay(
        self, replayer: Divisible, hypotheses: Sequence[Sequence[Planted]]
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """See :class:`wt.physics.runner.Runner`."""
        import ray

        parts = split(len(hypotheses), len(replayer.stretches), cores())
        source = [self._put(replayer)]  # in a list Ray hands on the reference, not the thing
        pending = [
            self._task.remote(versions(), source, told(replayer, hypotheses[h]), s)
            for h, s in parts
        ]
        with called_off(pending):
            results = ray.get(pending)
        return joined(replayer, len(hypotheses), parts, results)

    def _put(self, replayer: Divisible) -> ObjectRef:
        import ray

        if replayer not in self._prepared:
            scene = replayer.scene
            if scene not in self._scenes:
                self._scenes[scene] = ray.put(PackedScene.of(scene))
            prepared = _Prepared(self._scenes[scene], packed(replayer))
            self._prepared[replayer] = ray.put(prepared)
        return self._prepared[replayer]


# -- in a worker -----------------------------------------------------------------------------------


def _replay(
    as_caller: dict[str, str],
    source: Sequence[ObjectRef],
    hypotheses: bytes,
    stretches: Sequence[int],
) -> Float[np.ndarray, "2 hypothesis sample dof"]:
    """One part of :meth:`Cluster.replay`, (2, H, N, nv)."""
    same_versions(as_caller)
    replayer = _replayer(source[0])
    return replayer.part(heard(replayer, hypotheses), stretches, threads=1)


@functools.lru_cache(_KEPT)
def _replayer(source: ObjectRef) -> Replayer:
    import ray

    prepared = ray.get(source)
    return unpacked(_scene(prepared.scene), prepared.rest)


@functools.lru_cache(_KEPT)
def _scene(source: ObjectRef) -> Scene:
    import ray

    return ray.get(source).unpacked(_folder)


def _folder() -> Path:
    """A new one among the session's own files; Ray ends workers too abruptly to tidy up."""
    import ray

    context = ray.get_runtime_context()
    session = Path(context.get_temp_dir()) / context.get_session_name()
    return Path(tempfile.mkdtemp(prefix="wt-", dir=session))
