"""One environment in several processes, for machines with many cores.

Physics runs on as many threads as there are cores, but what comes after it (observations, rewards,
restarts) on one. In processes of their own, parts of the robots have both to themselves. What they
exchange with the trainer lies in memory that all of them see.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import RawArray
from typing import Any

import numpy as np
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from wt.errors import WorkError
from wt.locomotion.config import PolicyConfig
from wt.locomotion.env import Walking
from wt.locomotion.mirror import ACTOR_AND_CRITIC

Raw = dict[str, tuple[Any, str, tuple[int, ...]]]
"""Memory that processes share, by name: bytes, type and shape of the array in them."""

_SEEDS = 1000  # between the seeds of two parts
_STEP, _REPORT = b"step", b"report"
_SINGLE = {"reward": "f4", "done": "?", "time_out": "?", "length": "i8"}  # values per robot


Make = Callable[[PolicyConfig, str], Walking]
"""Makes an environment for a device; it can be pickled."""


def environment(config: PolicyConfig, device: str, make: Make = Walking) -> Walking | Parts:
    """An environment in as many processes as the configuration says.

    Args:
        config: what is trained.
        device: of the tensors.
        make: the environment, or each part of it.
    """
    return make(config, device) if config.processes == 1 else Parts(config, device, make)


class Parts(VecEnv):
    """``config.processes`` environments of equal size as one: :class:`wt.locomotion.env.Walking`.

    Attributes:
        mirror: for the symmetry extension.
    """

    def __init__(self, config: PolicyConfig, device: str, make: Make = Walking) -> None:
        """Start all processes and robots.

        Args:
            config: what is trained; each process has its share of the robots and its own seed.
            device: of the tensors; the simulation is on the processor.
            make: the environment of a part.
        """
        self.cfg, self.device = config, device
        one = make(replace(config, robots=1, processes=1, threads=1), device)
        self.num_envs, self.num_actions = config.robots, one.num_actions
        self.max_episode_length, self.mirror = one.max_episode_length, one.mirror
        widths = {name: group.shape[1] for name, group in one.get_observations().items()}
        raw = _allocate(config.robots, widths | {"action": one.num_actions})
        self._shared = _views(raw)
        self.episode_length_buf = torch.from_numpy(self._shared["length"])
        context = multiprocessing.get_context("spawn")
        self._links: list[Connection] = []
        for k, rows in enumerate(_shares(config)):
            ours, theirs = context.Pipe()
            part = replace(
                config, robots=rows.stop - rows.start, processes=1, seed=config.seed + _SEEDS * k
            )
            context.Process(
                target=_serve, args=(make, part, theirs, raw, rows), daemon=True
            ).start()
            theirs.close()  # so that the end of the process is the end of the connection
            self._links.append(ours)
        self._await()

    def get_observations(self) -> TensorDict:
        """The observations as they are now."""
        groups = {name: self._copy(name) for name in ACTOR_AND_CRITIC}
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """One control step; robots that fall or are out of time start anew."""
        self._shared["action"][:] = actions.cpu().numpy()
        self._tell(_STEP)
        self._await()
        extras = {"time_outs": self._copy("time_out")}
        return self.get_observations(), self._copy("reward"), self._copy("done"), extras

    def report(self) -> dict[str, float]:
        """Means since the last call over all parts, as :meth:`wt.locomotion.env.Walking.report`."""
        self._tell(_REPORT)
        rows: list[dict[str, float]] = self._await()
        return {name: sum(row[name] for row in rows) / len(rows) for name in rows[0]}

    def _copy(self, name: str) -> torch.Tensor:
        # a copy, since the next step writes over what is shared
        return torch.tensor(self._shared[name], device=self.device)

    def _tell(self, message: bytes) -> None:
        with suppress(OSError):  # of a process that is gone: _await says so
            for link in self._links:
                link.send_bytes(message)

    def _await(self) -> list[Any]:
        try:
            return [link.recv() for link in self._links]
        except (EOFError, OSError) as error:
            raise WorkError(
                "a process of the training's environment ended; what it printed says why, or take "
                "processes=1"
            ) from error


def _shares(config: PolicyConfig) -> Iterator[slice]:
    size = config.robots // config.processes
    return (slice(k * size, (k + 1) * size) for k in range(config.processes))


def _allocate(robots: int, widths: Mapping[str, int]) -> Raw:
    """Memory for all robots: rows of those widths, and single values."""
    kinds = dict.fromkeys(widths, "f4") | _SINGLE
    out: Raw = {}
    for name, kind in kinds.items():
        shape = (robots, widths[name]) if name in widths else (robots,)
        out[name] = (RawArray("b", np.dtype(kind).itemsize * int(np.prod(shape))), kind, shape)
    return out


def _views(raw: Raw) -> dict[str, np.ndarray]:
    return {
        name: np.frombuffer(memory, kind).reshape(shape)
        for name, (memory, kind, shape) in raw.items()
    }


def _publish(shared: Mapping[str, np.ndarray], observations: TensorDict) -> None:
    for name in ACTOR_AND_CRITIC:
        shared[name][:] = observations[name].numpy()


def _serve(make: Make, config: PolicyConfig, link: Connection, raw: Raw, rows: slice) -> None:
    """Run a part of the robots in its rows of the arrays, until the trainer is gone.

    It answers every message: None when what is shared is up to date, else the report.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the trainer keeps what there is
    torch.set_num_threads(1)
    shared = {name: array[rows] for name, array in _views(raw).items()}
    env = make(config, "cpu")
    shared["length"][:] = env.episode_length_buf.numpy()
    env.episode_length_buf = torch.from_numpy(shared["length"])
    _publish(shared, env.get_observations())
    link.send(None)
    with suppress(EOFError, BrokenPipeError):
        while True:
            if link.recv_bytes() == _REPORT:
                link.send(env.report())
                continue
            observations, reward, done, extras = env.step(torch.from_numpy(shared["action"]))
            _publish(shared, observations)
            shared["reward"][:], shared["done"][:] = reward.numpy(), done.numpy()
            shared["time_out"][:] = extras["time_outs"].numpy()
            link.send(None)
