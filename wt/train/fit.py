"""Train one World Translation model from transitions: frame, mean field, Algorithm 1, choice."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from wt.config import Method
from wt.data.stored import Streams
from wt.nets.mlp import Ensemble
from wt.nets.simulator_use import UNTRIED, DomainSamples, use_of
from wt.nets.world_model import WorldModel
from wt.train.answers import answers_of, with_answers
from wt.train.batches import Feed, in_frame, within
from wt.train.data import TranslationData
from wt.train.family import Family, family_of
from wt.train.hidden import Simulator
from wt.train.logger import Curves, MetricSink
from wt.train.loop import run
from wt.train.mean_field import (
    Scores,
    fit_mean_field,
    fit_normalizers,
    gaussian_transport,
    held_out_losses,
    regressions,
)
from wt.train.module import WorldTranslation
from wt.train.regression import Progress, Score, part_of
from wt.train.score import PairTensors, predictions, score
from wt.train.segments import Segments
from wt.train.selection import Paired, Selection, Unpaired
from wt.train.streamed import drawn, lessons
from wt.types import Pairs, Transitions, TransitionSpec

IN_MEMORY = Streams()
"""Nothing is streamed."""
STRENGTHS = tuple(k / 10 for k in range(11))
"""Shares of an anchored translation that are tried on what is held out."""


def _ignore(metrics: Mapping[str, float], step: int) -> None:
    """The metric sink of a run that nobody tracks."""


@dataclass(frozen=True)
class TrainingInput:
    """What a World Translation is trained on, and how.

    Attributes:
        spec: layout of the transitions.
        method: which World Translation: the paper's or ours.
        sim: unpaired transitions of S.
        real: unpaired transitions of R.
        selection: held-out data that choose; nothing is trained on them.
        seed: same seed, same model on the same machine.
        folder: checkpoints are kept here and continued from.
        simulator: S, which ``mean.simulator: encoded`` steps again.
        streams: whole collections of which ``sim`` or ``real`` is a sample.
        lessons: transitions of simulators around S, from which the same learns what R does; see
            :mod:`wt.train.family`.
    """

    spec: TransitionSpec
    method: Method
    sim: Transitions
    real: Transitions
    selection: Selection
    seed: int
    folder: Path
    simulator: Simulator | None = None
    streams: Streams = IN_MEMORY
    lessons: Transitions | None = None


def fit_world_model(
    given: TrainingInput,
    *,
    test: Pairs | None = None,
    sink: MetricSink = _ignore,
    warn: Callable[[str], None] = warnings.warn,
    progress: Progress | None = None,
) -> WorldModel:
    """Train a model, or finish one whose checkpoints are in the folder that is given.

    Args:
        given: what to train it on.
        test: pairs that the data module has for ``Trainer.test``; nothing here looks at them.
        sink: where metrics go.
        warn: called with one line when training collapses.
        progress: called with (done, total) steps of mean field and loop together.

    Returns:
        The chosen model, in evaluation mode.

    Raises:
        ConfigError: a simulator that the method steps is missing.
        WorkError: training diverged.
    """
    begun, method = fitted(given, sink=sink, progress=progress), given.method
    if not translates(method, given.selection):
        begun.model.strength.fill_(0.0)
        return begun.model.eval()
    along = part_of(progress, begun.steps, begun.steps + method.train.steps)
    best = run(*begun.module_and_data(given.seed, test), given.folder, sink, warn, along)
    return _chosen(best, begun.selection)


class Fitted(NamedTuple):
    """What Algorithm 1 begins with.

    Attributes:
        model: with a fitted mean field and the chosen transport.
        sim: transitions of S within reach.
        real: of R, likewise, with S's answers where the mean field asks for them.
        streams: collections of which these are samples.
        selection: held-out data, with S's answers likewise.
        steps: of the regressions that were taken.
    """

    model: WorldModel
    sim: Transitions
    real: Transitions
    streams: Streams
    selection: Selection
    steps: int

    def module_and_data(
        self, seed: int, test: Pairs | None = None
    ) -> tuple[WorldTranslation, TranslationData]:
        """Algorithm 1 and its batches, for a ``lightning.Trainer``.

        Args:
            seed: same seed, same batches.
            test: pairs for ``Trainer.test``.
        """
        model, train = self.model, self.model.method.train
        segments = Segments(self.real, train.segment, train.batch) if train.segment > 1 else None
        data = TranslationData(
            *drawn(model, self.sim, self.real, self.streams, seed),
            self.selection,
            batch=train.batch,
            latent=model.method.nets.latent,
            seed=seed,
            segments=segments,
            test=test,
        )
        return WorldTranslation(model.spec, model.method, model), data


def fitted(
    given: TrainingInput, *, sink: MetricSink = _ignore, progress: Progress | None = None
) -> Fitted:
    """Fit normalisers and mean field, and choose the transport.

    Arguments are those of :func:`fit_world_model`; progress is of the total, with the steps of
    Algorithm 1 that follow.
    """
    method, seed, streams = given.method, given.seed, given.streams
    sim, real, selection = given.sim, given.real, given.selection
    torch.manual_seed(seed)
    model = WorldModel(given.spec, method)
    fit_normalizers(model.frame, sim, real)
    family = family_of(model.frame, method.mean, seed, given.simulator, given.lessons)
    if family:
        return _of_family(family, model, given, progress)
    answers = answers_of(model.frame, method.mean, seed, given.simulator)
    first = answers.regressions * method.mean.steps if answers else 0
    before = first + regressions(method.mean) * method.mean.steps
    steps = before + (model.frame.hidden is not None) * method.mean.steps
    total = steps + translates(method, selection) * method.train.steps
    if answers:
        of_answers = part_of(progress, 0, total)
        real, selection = with_answers(answers, sim, real, selection, of_answers)
    whole = real
    sim, real = (within(model.frame, x, method.translation.reach) for x in (sim, real))
    sources = lessons(model, sim, real, streams, seed, answers.of if answers else None)
    with _kept_mean_field(model, given.folder) as missing:
        if missing:
            along = part_of(progress, first, total)
            _mean_field(model, *sources, selection, seed, along, sink)
            if answers:
                held = selection.predicted.real
                answers.carry(model, whole, held, part_of(progress, before, total))
    if answers:
        streams = streams._replace(real=None)  # Algorithm 1 has R's sample, with S's answers
    _choose_transport(model, sim, real, selection)
    return Fitted(model, sim, real, streams, selection, steps)


def _of_family(
    family: Family, model: WorldModel, given: TrainingInput, progress: Progress | None
) -> Fitted:
    """Fit the mean field of simulators around S, and of R's place among them."""
    method, selection = given.method, given.selection
    steps = family.regressions * method.mean.steps
    total = steps + translates(method, selection) * method.train.steps
    along = part_of(progress, 0, total)
    family.learn(given.sim, given.real, along)
    sim, real = (within(model.frame, x, method.translation.reach) for x in (given.sim, given.real))
    real, held = family.answered(real), family.answered(selection.predicted.real)
    if isinstance(selection, Unpaired):
        selection = Unpaired(selection.sim, held)
    with _kept_mean_field(model, given.folder) as missing:
        if missing:
            family.fit(model, real, held, along)
    # R's sample has S's answers, which what is streamed has not
    return Fitted(model, sim, real, given.streams._replace(real=None), selection, steps)


def translates(method: Method, selection: Selection) -> bool:
    """Whether Algorithm 1 may have a say in the model."""
    whole = not method.translation.anchored
    return whole or isinstance(selection, Paired) or use_of(method.mean).translates_unpaired


@contextmanager
def _kept_mean_field(model: WorldModel, folder: Path) -> Iterator[bool]:
    """Whether a mean field is still to be fitted: an interrupted run finds it again."""
    kept = folder / "mean_field.pt"
    missing = not kept.exists()
    if not missing:
        model.frame.load_state_dict(torch.load(kept, "cpu", weights_only=True))
    yield missing
    model.frame.requires_grad_(False)
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        torch.save(model.frame.state_dict(), kept.with_suffix(".tmp"))
        kept.with_suffix(".tmp").replace(kept)


def _mean_field(
    model: WorldModel,
    sim: Feed[DomainSamples],
    real: Feed[DomainSamples],
    selection: Selection,
    seed: int,
    progress: Progress | None,
    sink: MetricSink,
) -> None:
    """Fit the mean field, scored on what is held out."""
    curves, each = Curves(sink, progress), _scores(model, selection)._asdict()
    scores = Scores(**{name: s and curves.drawn(name, s) for name, s in each.items()})
    fit_mean_field(model.frame, sim, real, model.method.mean, seed, curves.follow, scores)


def _scores(model: WorldModel, selection: Selection) -> Scores:
    """Errors on what is held out that stop δ, n and the reader from being over-trained."""
    frame, use = model.frame, use_of(model.method.mean)
    if not use.has_shift:
        return Scores()
    if isinstance(selection, Unpaired):
        return held_out_losses(frame, selection.sim, selection.real, model.method.mean)
    if use.scored_alone:
        pairs = PairTensors.of(selection.translated, frame.state.std, frame.change.std)
        # averages, so that the rest of S's answer, which only a translation can tell, is left out
        x = frame.conditions(pairs.o, pairs.a)
        seen = frame.within(x, model.method.translation.reach)
        o, x = pairs.o[seen], x[seen]
        simulated, real = (frame.changes(o, s[seen]) for s in (pairs.sim_next, pairs.real_next))
        return Scores(
            _mse(lambda: frame.nominal_change(x) + frame.shift_change(x, simulated) - real),
            _mse(lambda: frame.nominal_change(x) - simulated),
            _mse(lambda: frame.read_change(x, simulated) - real),
        )
    # an untrained decoder has no say only where its difference is added to the simulator's answer
    anchored = model.method.translation.anchored
    return Scores((lambda: score(model, selection)) if anchored else None)


def _mse(error: Callable[[], Tensor]) -> Score:
    @torch.no_grad()
    def mse() -> float:
        return float((error() ** 2).mean())

    return mse


def _choose_transport(
    model: WorldModel, sim: Transitions, real: Transitions, selection: Selection
) -> None:
    """Take the closed-form transport or not, and shares of those :class:`SimulatorUse` has tried.

    Whatever is nearest to R on what is held out. Without pairs δ's share is scored by itself, at
    R's (o, a); S's is not tried, since what S and R say of the same event is seen by pairs alone.
    """
    frame, use = model.frame, use_of(model.method.mean)
    if not (model.method.translation.transport and use.transported):
        return
    plain, shift = frame.transport.clone(), copy.deepcopy(frame.shift)
    shift_shares, outcome_shares = use.shift_shares, use.outcome_shares
    if isinstance(selection, Unpaired):
        shift_shares = (_best_shift_share(model, selection, use.shift_shares),)
        outcome_shares = (use.untried_share,)
    best = math.inf, plain, shift
    for part in shift_shares:
        frame.shift = _scaled(shift, part)
        source, target = in_frame(frame, sim, real)
        for option in (plain, gaussian_transport(source.y, target.y)):
            for share in outcome_shares:
                frame.transport.copy_(share * option)
                error = score(model, selection)
                if error < best[0]:
                    best = error, share * option, frame.shift
    frame.transport.copy_(best[1])
    frame.shift = best[2]


def _best_shift_share(model: WorldModel, selection: Unpaired, shares: Sequence[float]) -> float:
    """The share of δ that has the least error on R's held-out transitions."""
    frame, shift, errors = model.frame, model.frame.shift, []
    score = held_out_losses(frame, selection.sim, selection.real, model.method.mean).shift
    for share in shares:
        frame.shift = _scaled(shift, share)
        errors.append(score() if score else 0.0)
    frame.shift = shift
    return shares[errors.index(min(errors))]


@torch.no_grad()
def _scaled(shift: Ensemble | None, share: float) -> Ensemble | None:
    """Regressors whose answers are a share of those of others."""
    scaled = copy.deepcopy(shift)
    for member in scaled.members if scaled else ():
        last = list(member.children())[-1]
        for values in last.parameters():
            values.mul_(share)
    return scaled


def _chosen(model: WorldModel, selection: Selection) -> WorldModel:
    """The model, with the shares of its translation and of its reader chosen."""
    _choose_strength(model, selection)
    _choose_trust(model, selection)
    return model


@torch.no_grad()
def _choose_strength(model: WorldModel, selection: Selection) -> None:
    """Apply as much of an anchored translation as helps on what is held out."""
    if not model.method.translation.anchored:
        return
    scores = []
    for strength in STRENGTHS:
        model.strength.fill_(strength)
        scores.append(score(model, selection))
    model.strength.fill_(STRENGTHS[scores.index(min(scores))])


@torch.no_grad()
def _choose_trust(model: WorldModel, selection: Selection) -> None:
    """Set the reader's share of the answer, where there is a reader.

    On pairs it is fitted, by least squares and for each channel: the only weights that pairs train.
    Nothing else tells it, and without them both answers have the same share.
    """
    frame = model.frame
    if frame.reader is None:
        return
    if isinstance(selection, Unpaired):
        frame.trusted.fill_(UNTRIED)
        return
    pairs = PairTensors.of(selection.translated, frame.state.std, frame.change.std)
    answers = []
    for share in (0.0, 1.0):
        frame.trusted.fill_(share)
        answers.append(frame.changes(pairs.o, predictions(model, pairs)))
    translated, read = answers
    off, apart = frame.changes(pairs.o, pairs.real_next) - translated, read - translated
    best = (off * apart).sum(dim=0) / (apart**2).sum(dim=0).clamp_min(1e-12)
    frame.trusted.copy_(best.clamp(0.0, 1.0))
