"""Train one World Translation model from transitions: frame, mean field, Algorithm 1, choice."""

from __future__ import annotations

import copy
import logging
import math
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lightning
import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from torch import Tensor

from wt.config import Method, Train
from wt.nets.mlp import Ensemble
from wt.nets.simulator_use import use_of
from wt.nets.world_model import WorldModel
from wt.train.batches import in_frame
from wt.train.callbacks import CollapseWatch, ShowProgress
from wt.train.checkpoints import WholeCheckpoints
from wt.train.data import TranslationData
from wt.train.device import beside
from wt.train.logger import MetricSink, SinkLogger
from wt.train.mean_field import (
    Scores,
    fit_mean_field,
    fit_normalizers,
    gaussian_transport,
    regressions,
)
from wt.train.module import WorldTranslation
from wt.train.regression import Progress, Score
from wt.train.replicas import OneMachine, Place, Unwrapped, end_with_parent, followers
from wt.train.score import PairTensors, errors, predictions
from wt.train.segments import Segments
from wt.types import Pairs, Transitions, TransitionSpec

STRENGTHS = tuple(k / 10 for k in range(11))
"""Shares of an anchored translation that are tried on the validation pairs."""


def _ignore(metrics: Mapping[str, float], step: int) -> None:
    """The metric sink of a run that nobody tracks."""


def fit_world_model(
    spec: TransitionSpec,
    method: Method,
    sim: Transitions,
    real: Transitions,
    validation: Pairs,
    seed: int,
    folder: Path,
    *,
    sink: MetricSink = _ignore,
    warn: Callable[[str], None] = warnings.warn,
    progress: Progress | None = None,
) -> WorldModel:
    """Train a model, or finish one whose checkpoints are in ``folder``.

    Args:
        spec: layout of the transitions.
        method: which World Translation: the paper's or ours.
        sim: unpaired transitions of S.
        real: unpaired transitions of R.
        validation: pairs that choose between checkpoints; nothing is trained on them.
        seed: same seed, same model on the same machine.
        folder: checkpoints are kept here and continued from.
        sink: where metrics go.
        warn: called with one line when training collapses.
        progress: called with (done, total) steps of mean field and loop together.

    Returns:
        The chosen model, in evaluation mode.

    Raises:
        WorkError: training diverged.
    """
    torch.manual_seed(seed)
    model = WorldModel(spec, method)
    fit_normalizers(model.frame, sim, real)
    pairs = PairTensors.of(validation, model.frame.state.std, _change_std(real, spec))
    sim, real = (_within(model, data) for data in (sim, real))
    extra = regressions(method.mean) * method.mean.steps
    total = extra + method.train.steps
    in_front = progress and (lambda k, _: progress(k, total))
    _mean_field(model, sim, real, pairs, seed, folder, in_front)
    _choose_transport(model, sim, real, pairs)
    data = in_frame(model.frame, sim, real)
    train = method.train
    segments = Segments(real, train.segment, train.batch) if train.segment > 1 else None
    loaded = TranslationData(
        *data, pairs, batch=train.batch, latent=method.nets.latent, seed=seed, segments=segments
    )
    module = WorldTranslation(spec, method, model)
    on_step = progress and (lambda k, _: progress(extra + k, total))
    best = _run(module, loaded, folder, sink, warn, on_step)
    module.load_state_dict(torch.load(best, "cpu", weights_only=True)["state_dict"])
    chosen = module.deployed().eval()
    _choose_strength(chosen, pairs)
    _fit_trust_on_pairs(chosen, pairs)
    return chosen


def _mean_field(
    model: WorldModel,
    sim: Transitions,
    real: Transitions,
    pairs: PairTensors,
    seed: int,
    folder: Path,
    progress: Progress | None,
) -> None:
    """Fit the mean field once; an interrupted run finds it again."""
    kept = folder / "mean_field.pt"
    if kept.exists():
        model.frame.load_state_dict(torch.load(kept, "cpu", weights_only=True))
        model.frame.requires_grad_(False)
        return
    scores = _scores(model, pairs)
    fit_mean_field(model.frame, sim, real, model.method.mean, seed, progress, scores)
    folder.mkdir(parents=True, exist_ok=True)
    torch.save(model.frame.state_dict(), kept.with_suffix(".tmp"))
    kept.with_suffix(".tmp").replace(kept)


def _within(model: WorldModel, data: Transitions) -> Transitions:
    """The transitions that are translated: of the others a few would outweigh many."""
    reach = model.method.translation.reach
    if not reach:
        return data
    x = model.frame.conditions(torch.tensor(data.o), torch.tensor(data.a))
    return data.select(model.frame.within(x, reach).cpu().numpy())


def _scores(model: WorldModel, pairs: PairTensors) -> Scores:
    """Errors on the validation pairs that stop δ, n and the reader from being over-trained."""
    frame, use = model.frame, use_of(model.method.mean)
    if not use.has_shift:
        return Scores()
    if use.scored_alone:
        # averages, so that the rest of S's answer, which only a translation can tell, is left out
        x = frame.conditions(pairs.o, pairs.a)
        seen = frame.within(x, model.method.translation.reach)
        o, x = pairs.o[seen], x[seen]
        simulated, real = (frame.changes(o, s[seen]) for s in (pairs.sim_next, pairs.real_next))
        return Scores(
            _score(lambda: frame.nominal_change(x) + frame.shift_change(x, simulated) - real),
            _score(lambda: frame.nominal_change(x) - simulated),
            _score(lambda: frame.read_change(x, simulated) - real),
        )
    # an untrained decoder has no say only where its difference is added to the simulator's answer
    anchored = model.method.translation.anchored
    return Scores((lambda: errors(model, pairs)[0]) if anchored else None)


def _score(error: Callable[[], Tensor]) -> Score:
    @torch.no_grad()
    def score() -> float:
        return float((error() ** 2).mean())

    return score


def _run(
    module: WorldTranslation,
    data: TranslationData,
    folder: Path,
    sink: MetricSink,
    warn: Callable[[str], None],
    progress: Progress | None,
) -> Path:
    """Algorithm 1's loop; returns the checkpoint with the lowest validation error."""
    train, device = module.model.method.train, torch.get_default_device()
    watchers: list[lightning.Callback] = [CollapseWatch(warn, train.log_every)]
    if progress:
        watchers.append(ShowProgress(progress, train.log_every))
    given: tuple[Any, ...] = ()
    if train.devices > 1:
        # a copy: tensors that are given to another process are the same memory in both
        given = copy.deepcopy(module).cpu(), data.to(torch.device("cpu")), folder, device
    with followers(train.devices, _follow, given) as place:
        best = _loop(module, data, folder, place, watchers, SinkLogger(sink))
    module.to(device)  # Lightning leaves what it trained on the CPU
    return best


def _follow(
    place: Place,
    module: WorldTranslation,
    data: TranslationData,
    folder: Path,
    leader: torch.device,
) -> None:
    """Train along with the process that leads, and leave everything else to it."""
    end_with_parent()
    torch.set_num_threads(1)
    with beside(leader, place.rank) as device:
        _loop(copy.deepcopy(module), data.to(device), folder, place, [], None)


def _loop(
    module: WorldTranslation,
    data: TranslationData,
    folder: Path,
    place: Place | None,
    watchers: Sequence[lightning.Callback],
    logger: SinkLogger | None,
) -> Path:
    """Let Lightning train, from the newest checkpoint on; returns the best one."""
    train, device = module.model.method.train, torch.get_default_device()
    best = ModelCheckpoint(folder, "best", monitor="val/mse")
    # one of its own: save_last of the one above writes only when the error has fallen
    newest = ModelCheckpoint(folder, "last", enable_version_counter=False)
    last = folder / "last.ckpt"
    if train.compile:
        for net in module.model.children():
            net.compile()
    with _unadvised():
        trainer = lightning.Trainer(
            **_placed(place, device, train),
            precision=train.precision,
            max_epochs=train.steps // train.validate_every,
            limit_train_batches=train.validate_every,
            log_every_n_steps=1,  # the module says when
            callbacks=[*watchers, best, newest],
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
    return Path(best.best_model_path)


def _placed(place: Place | None, device: torch.device, train: Train) -> dict[str, Any]:
    """The Trainer's arguments on where it trains."""
    plugins: list[Any] = [WholeCheckpoints()]
    if place is None:
        alone: int | list[int] = 1 if device.index is None else [device.index]
        return {"accelerator": device.type, "devices": alone, "plugins": plugins}
    leader = beside(device, -place.rank)
    each = [beside(leader, rank).index for rank in range(place.size)]
    return {
        "accelerator": device.type,
        "devices": place.size if device.type == "cpu" else each,
        "num_nodes": train.nodes,
        "strategy": Unwrapped(),
        "plugins": [*plugins, OneMachine(place)],
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


def _change_std(real: Transitions, spec: TransitionSpec) -> torch.Tensor:
    return torch.tensor((real.s_next - real.o[:, : spec.n_state]).std(axis=0) + 1e-12)


def _choose_transport(
    model: WorldModel, sim: Transitions, real: Transitions, pairs: PairTensors
) -> None:
    """Take the closed-form transport, and as large shares as :class:`SimulatorUse` has tried.

    The validation pairs decide.
    """
    if not model.method.translation.transport:
        return
    frame, use = model.frame, use_of(model.method.mean)
    plain, shift = frame.transport.clone(), copy.deepcopy(frame.shift)
    best = math.inf, plain, shift
    for part in use.shift_shares:
        frame.shift = _scaled(shift, part)
        source, target = in_frame(frame, sim, real)
        for option in (plain, gaussian_transport(source.y, target.y)):
            for share in use.outcome_shares:
                frame.transport.copy_(share * option)
                error = errors(model, pairs)[0]
                if error < best[0]:
                    best = error, share * option, frame.shift
    frame.transport.copy_(best[1])
    frame.shift = best[2]


@torch.no_grad()
def _scaled(shift: Ensemble | None, share: float) -> Ensemble | None:
    """Regressors whose answers are a share of those of others."""
    scaled = copy.deepcopy(shift)
    for member in scaled.members if scaled else ():
        last = list(member.children())[-1]
        for values in last.parameters():
            values.mul_(share)
    return scaled


@torch.no_grad()
def _choose_strength(model: WorldModel, pairs: PairTensors) -> None:
    """Apply as much of an anchored translation as helps on the validation pairs."""
    if not model.method.translation.anchored:
        return
    scores = []
    for strength in STRENGTHS:
        model.strength.fill_(strength)
        scores.append(errors(model, pairs)[0])
    model.strength.fill_(STRENGTHS[scores.index(min(scores))])


@torch.no_grad()
def _fit_trust_on_pairs(model: WorldModel, pairs: PairTensors) -> None:
    """Fit the reader's share of each channel to R by least squares on the validation pairs.

    Of all weights these alone are fitted on pairs, and only with ``mean.simulator: blend``.
    """
    frame = model.frame
    if frame.reader is None:
        return
    answers = []
    for share in (0.0, 1.0):
        frame.trusted.fill_(share)
        answers.append(frame.changes(pairs.o, predictions(model, pairs)))
    translated, read = answers
    off, apart = frame.changes(pairs.o, pairs.real_next) - translated, read - translated
    best = (off * apart).sum(dim=0) / (apart**2).sum(dim=0).clamp_min(1e-12)
    frame.trusted.copy_(best.clamp(0.0, 1.0))
