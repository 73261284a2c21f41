"""Replays on the cores of this machine: on threads, or in processes where laws are stepped.

MuJoCo steps many simulations on threads of its own. Where a law acts at every step, what is between
two steps is Python's, which one thread of a process runs at a time: such replays are given to
processes, which are started once these have taken a while. Each is told once what is replayed along
which recordings, and then hypotheses. It ends as soon as nobody can talk to it any more.
"""

from __future__ import annotations

import functools
import itertools
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any
from weakref import WeakKeyDictionary

import cloudpickle
import numpy as np
from jaxtyping import Float

from wt.physics.acting import any_live
from wt.physics.packed import PackedScene, heard, packed, told, unpacked
from wt.physics.planted import Planted
from wt.physics.rollout import Replayer
from wt.physics.runner import Divisible, joined, split
from wt.physics.scene import Scene

_WORTH_S, _WORTH_STEPS = 6.0, 2000
"""Processes are started once live laws have taken so long [s], as long as the start of two takes,
and are given what takes so many steps: it takes them a moment to be told."""
_MOST = 16
"""Most processes: each has the libraries in memory once more."""
_KEPT, _SCENES = 40, 16
"""Replayers that a process keeps, and scenes of them: a diagnosis uses a few at a time, of each
limb of a machine."""


class _GoneError(Exception):
    """A process has ended, or cannot be told of a law."""


@contextmanager
def workers(count: int) -> Iterator[Workers]:
    """A runner on so many cores for the block; its processes end with it."""
    runner = Workers(count)
    try:
        yield runner
    finally:
        runner.close()


class Workers:
    """Runs replays on threads, and those with live laws in processes once these are worth it.

    Attributes:
        count: cores that are used.
    """

    def __init__(self, count: int) -> None:
        """Use so many cores."""
        self.count = count
        self._spent = 0.0
        self._processes: list[_Process] | None = []  # None once one is gone that should not be
        self._free: SimpleQueue[_Process] = SimpleQueue()
        self._keys: WeakKeyDictionary[Divisible, int] = WeakKeyDictionary()
        self._new_key = itertools.count()

    def replay(
        self, replays: Divisible, hypotheses: Sequence[Sequence[Planted]]
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """See :class:`wt.physics.runner.Runner`."""
        every = range(len(replays.stretches))
        live = [any_live(hypothesis) for hypothesis in hypotheses]
        seconds = sum(float(s.t[-1] - s.t[0]) for s in replays.stretches)
        worth = sum(live) * seconds / replays.step >= _WORTH_STEPS
        if not worth or self._processes is None:
            return replays.part(hypotheses, every, self.count)
        if self._spent < _WORTH_S:
            begun = time.monotonic()
            path = replays.part(hypotheses, every, self.count)
            self._spent += time.monotonic() - begun
            return path
        stepped, rest = np.flatnonzero(live).tolist(), np.flatnonzero(~np.array(live)).tolist()
        samples = sum(len(s.t) for s in replays.stretches)
        path = np.empty((2, len(hypotheses), samples, replays.scene.model.nv))
        try:
            path[:, stepped] = self._spread(replays, [hypotheses[h] for h in stepped])
        except _GoneError:
            self.close()
            self._processes = None
            return replays.part(hypotheses, every, self.count)
        if rest:
            path[:, rest] = replays.part([hypotheses[h] for h in rest], every, self.count)
        return path

    def close(self) -> None:
        """End the processes; others are started if more is asked for."""
        for process in self._processes or ():
            process.end()
        self._processes, self._free = [], SimpleQueue()

    def _started(self) -> list[_Process]:
        processes: list[_Process] = []
        try:
            for _ in range(min(self.count, _MOST)):
                processes.append(_Process())
                self._free.put(processes[-1])
        except OSError as error:  # this machine grants no more of them
            for process in processes:
                process.end()
            raise _GoneError from error
        return processes

    def _spread(
        self, replays: Divisible, hypotheses: Sequence[Sequence[Planted]]
    ) -> Float[np.ndarray, "2 hypothesis sample dof"]:
        """Replay in processes, each a part."""
        started = self._processes = self._processes or self._started()
        key = self._keys.setdefault(replays, next(self._new_key))

        @functools.cache
        def made_of() -> bytes:
            with _speakable():
                scene = cloudpickle.dumps(PackedScene.of(replays.scene))
                return pickle.dumps((key, scene, packed(replays)))

        parts = split(len(hypotheses), len(replays.stretches), len(started))
        with _speakable():
            asked = [pickle.dumps((key, told(replays, hypotheses[h]), tuple(s))) for h, s in parts]

        def said(question: bytes) -> Any:  # noqa: ANN401 – an array
            process = self._free.get()
            try:
                answer = process.ask(key, made_of, question)
            finally:
                self._free.put(process)
            if isinstance(answer, Exception):
                raise answer
            return answer

        with ThreadPoolExecutor(len(parts)) as pool:
            try:
                return joined(replays, len(hypotheses), parts, pool.map(said, asked))
            except BaseException:
                self.close()  # else what is under way would be waited for
                raise


class _Process:
    """One that replays what it is asked to, on a thread."""

    def __init__(self) -> None:
        """Start it; it gets ready while nobody waits for it."""
        where = {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"from {__name__} import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **where},
            start_new_session=True,  # Ctrl-C is the caller's
        )
        self._knows: list[int] = []

    def ask(self, key: int, packed: Callable[[], bytes], question: bytes) -> Any:  # noqa: ANN401
        """An array of replays, or the exception that was raised instead.

        Args:
            key: of the replayer.
            packed: says what it is made of, with its key.
            question: what to replay on it.

        Raises:
            _GoneError: it does not answer any more.
        """
        pipe, answers = self._process.stdin, self._process.stdout
        assert pipe is not None and answers is not None
        try:
            if key not in self._knows:
                # it forgets the first one of too many likewise
                self._knows = [*self._knows, key][-_KEPT:]
                pipe.write(packed())
            pipe.write(question)
            pipe.flush()
            return pickle.load(answers)
        except (OSError, ValueError, EOFError, pickle.UnpicklingError) as error:
            raise _GoneError from error

    def end(self) -> None:
        """End it, whatever it is doing."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(OSError):  # of what was not sent yet
                pipe.close()


@contextmanager
def _speakable() -> Iterator[None]:
    """What cannot be pickled, or whose files are gone meanwhile, no process can be told of."""
    try:
        yield
    except (OSError, ValueError, pickle.PicklingError, TypeError, AttributeError) as error:
        raise _GoneError from error


# -- in a process ----------------------------------------------------------------------------------


def serve() -> None:
    """Answer what comes in, until nothing does any more, or it cannot be read here."""
    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed is no answer
    replayers: dict[int, Replayer] = {}
    scenes: dict[bytes, Scene] = {}
    with ExitStack() as ends:

        def copies() -> Path:
            return Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="wt-")))

        while True:
            try:
                key, first, second = pickle.load(questions)
                if isinstance(second, bytes):  # the scene, and what is replayed on it
                    if first not in scenes:
                        scenes[first] = pickle.loads(first).unpacked(copies)
                    replayers[key] = unpacked(scenes[first], second)
                    for old in list(replayers)[:-_KEPT]:
                        del replayers[old]
                    for rest in list(scenes)[:-_SCENES]:
                        del scenes[rest]
                    continue
                replayer = replayers[key]
                hypotheses = heard(replayer, first)
            except Exception:  # nobody asks any more, or with words that are unknown here
                return
            try:
                answer: Any = replayer.part(hypotheses, second, threads=1)
            except Exception as error:
                answer = error
            pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
            answers.flush()
