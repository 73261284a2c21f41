"""Algorithm 1's loop under Lightning: in this process, on several devices, on several machines."""

from __future__ import annotations

import copy
import logging
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import lightning
import torch
from lightning.pytorch.callbacks import ModelCheckpoint

from wt.config import Train
from wt.errors import ConfigError
from wt.nets.world_model import WorldModel
from wt.train import machines
from wt.train.callbacks import CollapseWatch, RerunCurves, ShowProgress
from wt.train.checkpoints import WholeCheckpoints
from wt.train.data import TranslationData
from wt.train.device import beside, on
from wt.train.logger import MetricSink, SinkLogger
from wt.train.module import WorldTranslation
from wt.train.regression import Progress
from wt.train.replicas import Place, Placed, Unwrapped, end_with_parent, followers, leading

LAST = "last.ckpt"
"""The newest checkpoint, from which a training goes on."""


def refuse_absent(train: Train, device: torch.device) -> None:
    """Refuse devices and machines that are not there, before anything runs.

    Args:
        train: how many of them.
        device: what networks are trained on.

    Raises:
        UserError: there are fewer.
        WorkError: other machines are asked for, and Ray is not installed.
    """
    there = torch.cuda.device_count() if device.type == "cuda" else train.devices
    if train.devices > there:
        raise ConfigError(
            f"train.devices is {train.devices}; this machine has {there} CUDA devices: give as "
            "many at most, or device: cpu"
        )
    machines.refuse_absent(train, device.type == "cuda")


def run(
    module: WorldTranslation,
    data: TranslationData,
    folder: Path,
    sink: MetricSink,
    warn: Callable[[str], None],
    progress: Progress | None,
) -> WorldModel:
    """Train, or go on from the newest checkpoint in a folder.

    Args:
        module: on the device that is trained on, with a fitted mean field.
        data: on the same.
        folder: of checkpoints.
        sink: where metrics go.
        warn: called with one line when training collapses.
        progress: called with (done, total) steps.

    Returns:
        The latest model of the lowest error on what is held out, in evaluation mode.
    """
    train, device = module.model.method.train, torch.get_default_device()
    watchers: list[lightning.Callback] = [CollapseWatch(warn, train.log_every)]
    if progress:
        watchers.append(ShowProgress(progress, train.log_every))
    if train.rerun:
        watchers.append(RerunCurves(folder, train.log_every))
    with _together(module, data, folder) as place:
        best = _loop(module, data, folder, place, watchers, SinkLogger(sink))
    module.to(device)  # Lightning leaves what it trained on the CPU
    module.load_state_dict(torch.load(best, "cpu", weights_only=True)["state_dict"])
    return module.deployed().eval()


@contextmanager
def _together(
    module: WorldTranslation, data: TranslationData, folder: Path
) -> Iterator[Place | None]:
    """Start the other processes of a training; the place of this one, or None where it is alone."""
    train, device = module.model.method.train, torch.get_default_device()
    if train.devices * train.nodes == 1:
        yield None
        return
    # a copy: tensors that are given to another process are the same memory in both
    given = copy.deepcopy(module).cpu(), data.to(torch.device("cpu"))
    with ExitStack() as stack:
        if train.nodes == 1:
            place = leading(train.devices, 1)
        else:
            kept = (folder / LAST).read_bytes() if (folder / LAST).exists() else b""
            elsewhere = (*given, kept, device.type)
            there = machines.joined(train, device.type == "cuda", _lead_machine, elsewhere)
            place = stack.enter_context(there)
        stack.enter_context(followers(place, _follow, (*given, folder, device)))
        yield place


def _follow(
    place: Place,
    module: WorldTranslation,
    data: TranslationData,
    folder: Path,
    first: torch.device,
) -> None:
    """Train along in a process that :func:`followers` started, and leave all else to the leader.

    Args:
        place: of this process.
        module: on the CPU, in memory that it shares.
        data: likewise.
        folder: of checkpoints, to go on from.
        first: device of this machine's first process.
    """
    end_with_parent()
    _train_along(place, copy.deepcopy(module), data, folder, beside(first, place.local))


def _lead_machine(
    place: Place, module: WorldTranslation, data: TranslationData, kept: bytes, device: str
) -> None:
    """Train along on another machine than the leader's, with all processes that it has.

    Args:
        place: of this process, the first of its machine.
        module: on the CPU.
        data: likewise.
        kept: the newest checkpoint's bytes; empty where there is none.
        device: type of the device of each process.
    """
    first = torch.device(device, 0) if device == "cuda" else torch.device(device)
    with tempfile.TemporaryDirectory(prefix="wt-train-") as name:
        folder = Path(name)
        if kept:
            (folder / LAST).write_bytes(kept)
        with followers(place, _follow, (module, data, folder, first)):
            _train_along(place, copy.deepcopy(module), data, folder, first)


def _train_along(
    place: Place, module: WorldTranslation, data: TranslationData, folder: Path,
    device: torch.device,
) -> None:  # fmt: skip
    torch.set_num_threads(1)
    with on(device):
        _loop(module, data.to(device), folder, place, [], None)


def _loop(
    module: WorldTranslation,
    data: TranslationData,
    folder: Path,
    place: Place | None,
    watchers: Sequence[lightning.Callback],
    logger: SinkLogger | None,
) -> Path:
    """Let Lightning train, from the newest checkpoint on; returns the one that is kept."""
    train, device = module.model.method.train, torch.get_default_device()
    newest = kept = ModelCheckpoint(folder, Path(LAST).stem, enable_version_counter=False)
    if data.validation.tells_checkpoints:
        # one of its own: its save_last would write only when the error has fallen
        kept = ModelCheckpoint(folder, "best", monitor=f"val/{data.validation.metric}")
    last = folder / LAST
    if train.compile:
        for net in module.model.children():
            net.compile()
    with _unadvised():
        trainer = lightning.Trainer(
            **_placed(place, device, train),
            precision=train.precision,
            max_epochs=train.steps // train.validate_every,
            limit_train_batches=train.validate_every,
            log_every_n_steps=train.log_every,
            callbacks=[*watchers, *dict.fromkeys((kept, newest))],
            logger=logger or False,
            use_distributed_sampler=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            num_sanity_val_steps=0,
            default_root_dir=folder,
        )
        on_interrupt = signal.getsignal(signal.SIGINT)
        try:
            trainer.fit(module, data, ckpt_path=str(last) if last.exists() else None)
        except SystemExit as end:
            # Lightning's answer to Ctrl-C, which also leaves the signal ignored
            signal.signal(signal.SIGINT, on_interrupt)
            raise KeyboardInterrupt from end
    return Path(kept.best_model_path)


def _placed(place: Place | None, device: torch.device, train: Train) -> dict[str, Any]:
    """The Trainer's arguments on where it trains."""
    plugins: list[Any] = [WholeCheckpoints()]
    if place is None:
        alone: int | list[int] = 1 if device.index is None else [device.index]
        return {"accelerator": device.type, "devices": alone, "plugins": plugins}
    first = beside(device, -place.local)
    each = [beside(first, k).index for k in range(place.devices)]
    return {
        "accelerator": device.type,
        "devices": place.devices if device.type == "cpu" else each,
        "num_nodes": train.nodes,
        "strategy": Unwrapped(),
        "plugins": [*plugins, Placed(place)],
    }


@contextmanager
def _unadvised() -> Iterator[None]:
    """Hide Lightning's banner and its advice on data loaders, which are about other set-ups."""
    loggers = [logging.getLogger(f"lightning.{part}") for part in ("pytorch", "fabric")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="lightning")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
