"""The device of a training: the CPU, or a CUDA device where there is one.

All tensors of a training are made inside ``with on(…):``, so that no function has to be told where
it works. What is kept of a training is on the CPU, and so are evaluation and export.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from wt.config import Device
from wt.errors import ConfigError


def check(name: Device) -> None:
    """Refuse a device that this machine does not have.

    Raises:
        ConfigError: ``cuda``, and there is none.
    """
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device: 'cuda' was given, and torch finds none; use auto or cpu")


def device_of(name: Device, index: int = 0, *, replayed: bool = True) -> torch.device:
    """The device of a name.

    Args:
        name: ``cpu``, ``cuda`` or ``auto``, which is CUDA where there is any, for what is replayed.
        index: of this process among those that train side by side, which are spread over the
            machine's CUDA devices in turn.
        replayed: whether steps may be replayed as graphs (:mod:`wt.train.graphs`). Without, a core
            tells a device its kernels no faster than it does the work of networks so small.
    """
    if name == "auto" and not replayed:
        return torch.device("cpu")
    if name == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", index % torch.cuda.device_count())


@contextmanager
def on(device: torch.device) -> Iterator[None]:
    """A context in which new tensors are made on a device."""
    if device.type == "cpu":
        # they are anyway, and every call of torch inside of its own context goes through Python
        yield
        return
    with device:
        yield


def beside(device: torch.device, rank: int) -> torch.device:
    """The device of the process that is ``rank`` further than the one of ``device``."""
    return device if device.type == "cpu" else device_of("cuda", device.index + rank)


def seeded(seed: int) -> torch.Generator:
    """A generator on the device that tensors are made on now."""
    return torch.Generator(torch.get_default_device()).manual_seed(seed)
