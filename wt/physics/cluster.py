"""Replays on a Ray cluster: the one that ``RAY_ADDRESS`` names, else one of this machine's cores.

Workers are given the model's files and the stretches once, and then hypotheses. Nodes need this
package in the same versions, but no folder in common with the caller.
"""

from __future__ import annotations

import functools
import itertools
import os
import socket
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from jaxtyping import Float

from wt.errors import UserError, WorkError
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.runner import Divisible
from wt.physics.scene import Scene
from wt.version import __version__

if TYPE_CHECKING:
    from ray import ObjectRef


_ANSWER_S = 5.0
"""A cluster's address has so long to answer [s]; Ray itself would try for many minutes."""
_KEPT = 8
"""Replayers that a worker keeps; a diagnosis uses a few at a time."""


@contextmanager
def cluster() -> Iterator[Cluster]:
    """A Ray cluster for the block; what was started for it ends with it.

    Raises:
        UserError: Ray is not installed, or nothing answers at ``RAY_ADDRESS``.
        WorkError: Ray does not start on this machine.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # one failure is raised here; that others of the same call failed too is no news
    os.environ.setdefault("RAY_IGNORE_UNHANDLED_ERRORS", "1")
    try:
        import ray
    except ImportError as error:
        raise UserError(
            "jobs 'ray' needs Ray, which is not installed: pip install '.[scale]'"
        ) from error
    if ray.is_initialized():  # by the caller, who will want it afterwards
        yield Cluster()
        return
    try:
        _connect(os.environ.get("RAY_ADDRESS") or "local")
        yield Cluster()
    finally:
        ray.shutdown()


def _connect(address: str) -> None:
    import ray

    start: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address == "local":
        try:
            ray.init("local", include_dashboard=False, **start)
        except (OSError, RuntimeError, ValueError) as error:
            raise WorkError(
                f"Ray does not start here: {_first_words(error)}; run on threads, without it"
            ) from error
        return
    try:
        if address != "auto":
            socket.create_connection(_host_and_port(address), _ANSWER_S).close()
        with _hushed():
            ray.init(address, **start)
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        reason = _first_words(error)
        if "InvalidAuthToken" in str(error.__cause__):
            reason = "it wants a token: set RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN to its token"
        raise UserError(
            f"no Ray cluster can be used at RAY_ADDRESS '{address}': {reason}; start one ('ray "
            "start --head'), or unset RAY_ADDRESS to use this machine's cores"
        ) from error


@contextmanager
def _hushed() -> Iterator[None]:
    """Keep warnings from the terminal that Ray's core repeats while it tries to connect."""
    sys.stderr.flush()
    before = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


def _first_words(error: BaseException) -> str:
    """The start of what may be pages."""
    return (str(error).strip() or type(error).__name__).splitlines()[0].split(". ")[0]


def _host_and_port(address: str) -> tuple[str, int]:
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        raise UserError(f"RAY_ADDRESS '{address}' is neither HOST:PORT, ray://HOST:PORT nor 'auto'")
    return host.strip("[]"), int(port)


@dataclass(frozen=True, eq=False)
class _Model:
    """An MJCF and all files that it takes in, by their full paths."""

    path: Path
    files: Mapping[Path, bytes]


@dataclass(frozen=True, eq=False)
class _Prepared:
    """The ingredients of a replayer."""

    model: ObjectRef
    stretches: tuple[Stretch, ...]
    step: float


class Cluster:
    """Runs replays in Ray tasks of one thread each."""

    def __init__(self) -> None:
        """Use the cluster that this process is connected to."""
        import ray

        self._task = ray.remote(_replay)
        self._models: WeakKeyDictionary[Scene, ObjectRef] = WeakKeyDictionary()
        self._prepared: WeakKeyDictionary[Divisible, ObjectRef] = WeakKeyDictionary()

    def replay(
        self, replayer: Divisible, hypotheses: Sequence[Sequence[Planted]]
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """See :class:`wt.physics.runner.Runner`."""
        import ray

        ends = np.cumsum([0, *(len(s.t) for s in replayer.stretches)])
        cores = int(ray.cluster_resources().get("CPU", 0.0))
        if cores < 1:
            raise UserError("the Ray cluster has no CPU to give; start a node that has")
        parts = split(len(hypotheses), len(replayer.stretches), cores)
        source = [self._put(replayer)]  # in a list Ray hands on the reference, not the thing
        results = _gather(
            [self._task.remote(_versions(), source, hypotheses[h], s) for h, s in parts]
        )
        path = np.empty((2, len(hypotheses), int(ends[-1]), replayer.scene.model.nv))
        for (h, s), part in zip(parts, results, strict=True):
            path[:, h, ends[s.start] : ends[s.stop]] = part
        return path

    def _put(self, replayer: Divisible) -> ObjectRef:
        import ray

        if replayer not in self._prepared:
            scene = replayer.scene
            if scene not in self._models:
                self._models[scene] = ray.put(_packed(scene.path))
            model = self._models[scene]
            self._prepared[replayer] = ray.put(_Prepared(model, replayer.stretches, replayer.step))
        return self._prepared[replayer]


def split(hypotheses: int, stretches: int, cores: int) -> list[tuple[slice, range]]:
    """Divide hypotheses × stretches into about as many parts as there are cores.

    Hypotheses are dealt like cards, for neighbours are alike and take equally long. Only if they
    are fewer than cores, stretches are divided too: a model is compiled once in each part.
    """
    piles = max(1, min(hypotheses, cores))
    runs = min(stretches, -(-cores // piles))
    edges = [stretches * i // runs for i in range(runs + 1)]
    return [
        (slice(pile, None, piles), range(first, last))
        for pile in range(piles)
        for first, last in itertools.pairwise(edges)
    ]


_MOMENT_S = 1.0


def _gather(pending: Sequence[ObjectRef]) -> list[Float[np.ndarray, "2 _ _ dof"]]:
    """The results in order; if one fails or the user interrupts, the others are called off."""
    import ray

    try:
        return list(ray.get(list(pending)))
    except BaseException as error:
        cause = getattr(error, "cause", None)  # what a task raised
        with suppress(Exception):  # what went wrong first is what counts
            # Ray's core may crash where a task ends as it is called off: what raises in one task
            # mostly does in all, so those get a moment
            moment = _MOMENT_S if isinstance(cause, Exception) else 0.0
            _, running = ray.wait(list(pending), num_returns=len(pending), timeout=moment)
            for task in running:
                ray.cancel(task)
        if isinstance(cause, ImportError) or "failed to import" in str(cause):
            raise UserError(
                "a node of the Ray cluster lacks this package: install world-translation "
                f"{__version__} on all of its nodes"
            ) from error
        if isinstance(cause, Exception):
            raise cause from error  # as it would have been raised here
        if isinstance(error, ray.exceptions.RayError):
            raise WorkError(
                f"the Ray cluster failed: {_first_words(error)}; run again, or without Ray"
            ) from error
        raise


def _versions() -> dict[str, str]:
    """Versions of all that numbers may depend on."""
    return {"wt": __version__, "mujoco": mujoco.__version__, "numpy": np.__version__}


def _packed(path: Path) -> _Model:
    path = path.resolve()
    files = {Path(p).resolve() for p in mujoco.mju_getXMLDependencies(str(path))}
    return _Model(path, {p: p.read_bytes() for p in files})


# -- in a worker -----------------------------------------------------------------------------------


def _replay(
    versions: dict[str, str],
    source: Sequence[ObjectRef],
    hypotheses: Sequence[Sequence[Planted]],
    stretches: Sequence[int],
) -> Float[np.ndarray, "2 hypothesis sample dof"]:
    """One part of :meth:`Cluster.replay`, (2, H, N, nv)."""
    if versions != _versions():
        raise UserError(
            f"a node of the Ray cluster has {_versions()}, this machine has {versions}; "
            "install the same"
        )
    return _replayer(source[0]).part(hypotheses, stretches, threads=1)


@functools.lru_cache(_KEPT)
def _replayer(source: ObjectRef) -> Replayer:
    import ray

    prepared = ray.get(source)
    return Replayer(_scene(prepared.model), prepared.stretches, prepared.step)


@functools.lru_cache(_KEPT)
def _scene(source: ObjectRef) -> Scene:
    import ray

    return Scene(_unpacked(ray.get(source)))


def _unpacked(model: _Model) -> Path:
    """The MJCF where it was, if this machine has the same files there, else a copy."""
    if all(p.is_file() and p.read_bytes() == data for p, data in model.files.items()):
        return model.path
    above = os.path.commonpath([p.parent for p in model.files])
    folder = _folder()
    for path, data in model.files.items():
        copy = folder / path.relative_to(above)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(data)
    return folder / model.path.relative_to(above)


def _folder() -> Path:
    """A new one among the session's own files; Ray ends workers too abruptly to tidy up."""
    import ray

    context = ray.get_runtime_context()
    session = Path(context.get_temp_dir()) / context.get_session_name()
    return Path(tempfile.mkdtemp(prefix="wt-", dir=session))
