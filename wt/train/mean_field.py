"""The mean field, the same whatever is hidden: regressors n and δ, and the linear transport.

``n`` imitates the simulator with nothing hidden, so that an exported graph can tell from
(o, a, o′) what the hidden variable did. ``δ`` is what R does differently then. Where the hidden
variable is often absent, δ is the most frequent difference rather than the average one
(``mean.kind: mode``): the average is biased by whatever (o, a) gives away of the hidden variable.

What n and δ learn, and what stands beside them, depends on ``mean.simulator``: one class each in
``wt.nets.simulator_use``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import torch
from torch import Tensor, nn

from wt.config import Mean
from wt.losses.robust import cauchy
from wt.nets.frame import Frame
from wt.nets.mlp import in_chunks
from wt.nets.simulator_use import DomainSamples, Examples, use_of
from wt.train.batches import Feed
from wt.train.device import seeded
from wt.train.regression import (
    Loss,
    Progress,
    Regression,
    Score,
    mean_square,
    member_seed,
    one_by_one,
    part_of,
    regress,
)
from wt.types import Transitions

RIDGE = 1e-4
"""Added to both covariances [change variance]: directions that hidden things never move in."""


def fit_normalizers(frame: Frame, sim: Transitions, real: Transitions) -> None:
    """Take the frame's scales from both domains' transitions."""
    pairs = [(torch.tensor(d.o), torch.tensor(d.a)) for d in (sim, real)]
    frame.condition.fit(torch.cat([frame.raw_condition(o, a) for o, a in pairs]))
    n = frame.spec.n_state
    changes = [torch.tensor(d.s_next - d.o[:, :n]) for d in (sim, real)]
    frame.change.fit(torch.cat(changes))
    frame.state.fit(real.s_next)


class Scores(NamedTuple):
    """Errors on held-out data, which stop regressors from being over-trained; None for no stop.

    Attributes:
        shift: of δ.
        nominal: of n.
        reader: of the regressors that read S's answer.
    """

    shift: Score | None = None
    nominal: Score | None = None
    reader: Score | None = None


def fit_mean_field(
    frame: Frame,
    sim: Feed[DomainSamples],
    real: Feed[DomainSamples],
    settings: Mean,
    seed: int,
    progress: Progress | None = None,
    scores: Scores | None = None,
) -> None:
    """Train n on the simulator and δ on R against it; nothing for kind ``none``.

    Args:
        frame: a frame with fitted normalisers; its regressors are trained in place.
        sim: transitions of S; read are (o, a) and the nominal answer, or what came out.
        real: transitions of R.
        settings: kind, use of the simulator and budget.
        seed: same seed, same regressors.
        progress: called with (done, total) steps.
        scores: errors on held-out data; None keeps the last weights of all.
    """
    if frame.shift is None:
        return
    use, scores = use_of(settings), scores or Scores()
    turns = _turns(progress, settings)
    if frame.nominal is not None:
        turn = next(turns)
        examples = Lessons(use.nominal_examples, turn.first, sim, real)
        _fit(frame.nominal, examples, settings, seed, turn, mean_square, scores.nominal)

    def of_shift(of_real: DomainSamples) -> Examples:
        reference = use.reference(lambda x: in_chunks(frame.nominal_change, x), of_real)
        return use.shift_examples(of_real, reference)

    ensembles = (frame.shift, of_shift, scores.shift), (
        frame.reader, use.reader_examples, scores.reader
    )  # fmt: skip
    for ensemble, made, score in ensembles:
        for k, member in one_by_one(ensemble) if ensemble is not None else ():
            turn = next(turns)
            examples = Lessons(made, turn.first, real)
            of_member = member_seed(seed, k)
            _fit(
                member, examples, settings, of_member, turn, shift_loss(settings), score, noisy=True
            )
    frame.requires_grad_(False)


def held_out_losses(frame: Frame, sim: Transitions, real: Transitions, settings: Mean) -> Scores:
    """Each regressor's own loss on transitions that nothing is trained on: no pairs are needed.

    Args:
        frame: a frame with fitted normalisers, whose regressors are being trained.
        sim: transitions of S.
        real: transitions of R.
        settings: kind and use of the simulator.
    """
    use, of_real = use_of(settings), samples(frame, real)
    inputs, target = use.nominal_examples(samples(frame, sim), of_real)

    def shift_error() -> Tensor:
        # n is trained before δ, which learns what n leaves
        reference = use.reference(frame.nominal_change, of_real)
        return frame.shift_change(of_real.x, reference) - (of_real.change - reference)

    def score(error: Callable[[], Tensor], loss: Loss) -> Score:
        return torch.no_grad()(lambda: float(loss(error(), 1.0)))

    return Scores(
        score(shift_error, shift_loss(settings)),
        score(lambda: frame.nominal_change(inputs) - target, mean_square),
        score(lambda: frame.read_change(of_real.x, of_real.nominal) - of_real.change,
              shift_loss(settings)),
    )  # fmt: skip


def regressions(settings: Mean) -> int:
    """Number of regressions of ``settings.steps`` each that a mean field takes."""
    return use_of(settings).regressions(settings.members)


def shift_loss(settings: Mean) -> Loss:
    """Loss of δ, by ``mean.kind``: towards the average difference, or the most frequent one."""

    def mode(error: Tensor, progress: float) -> Tensor:
        return cauchy(error, settings.mode_width)

    return mode if settings.kind == "mode" else mean_square


@torch.no_grad()
def samples(frame: Frame, data: Transitions) -> DomainSamples:
    """Transitions in a frame, as its regressors see them."""
    o = torch.tensor(data.o)
    x = frame.conditions(o, torch.tensor(data.a))
    nominal = frame.changes(o, torch.tensor(data.nominal))
    return DomainSamples(x, nominal, frame.changes(o, torch.tensor(data.s_next)))


class Lessons:
    """Inputs of a regressor and the answers to them, of the transitions that a step draws from."""

    def __init__(
        self, made: Callable[..., Examples], first: int, *sources: Feed[DomainSamples]
    ) -> None:
        """Make none yet.

        Args:
            made: examples, of what each source has.
            first: step of the sources that the regression begins at.
            sources: of transitions.
        """
        self._made, self._first, self._sources = made, first, sources
        self._of: list[DomainSamples] = []

    def bring(self, step: int) -> int:
        """Have those of a step at hand; their number."""
        there = [source.at(self._first + step) for source in self._sources]
        if not self._of or any(x is not y for x, y in zip(there, self._of, strict=True)):
            self._of, self.now = there, self._made(*there)
        return len(self.now.inputs)


class Turn(NamedTuple):
    """One of the regressions that follow each other.

    Attributes:
        first: steps of all that are before it.
        progress: called with its own.
    """

    first: int
    progress: Progress | None


def _turns(progress: Progress | None, settings: Mean) -> Iterator[Turn]:
    """One regression after the other, as parts of all of them."""
    total = regressions(settings) * settings.steps
    for first in range(0, total, settings.steps):
        yield Turn(first, part_of(progress, first, total))


def _fit(
    net: nn.Module,
    lessons: Lessons,
    settings: Mean,
    seed: int,
    turn: Turn,
    loss: Loss,
    score: Score | None,
    *,
    noisy: bool = False,
) -> None:
    """Train one regressor, of δ and of readers on noisy inputs."""
    noise = seeded(seed)

    def error(rows: Tensor) -> Tensor:
        x = lessons.now.inputs[rows]
        if noisy and settings.input_noise:
            x = x + settings.input_noise * torch.randn(x.shape, generator=noise)
        out: Tensor = net(x) - lessons.now.target[rows]
        return out

    budget = Regression(settings.steps, settings.batch, settings.learning_rate, seed)
    regress(net, error, lessons.bring, budget, loss, turn.progress, score)


def gaussian_transport(source: Tensor, target: Tensor) -> Tensor:
    """The optimal linear map between two centred Gaussians (Dowson and Landau 1982).

    Args:
        source: samples, (N, channels).
        target: samples, (M, channels).

    Returns:
        T = Σ_s^{−1/2} (Σ_s^{1/2} Σ_t Σ_s^{1/2})^{1/2} Σ_s^{−1/2}, symmetric positive definite,
        (channels, channels): the covariance of ``source @ T`` is that of ``target``.
    """
    source_cov, target_cov = _second_moment(source), _second_moment(target)
    root, inverse_root = _power(source_cov, 0.5), _power(source_cov, -0.5)
    middle = _power(root @ target_cov @ root, 0.5)
    return (inverse_root @ middle @ inverse_root).to(source.dtype)


def _second_moment(samples: Tensor) -> Tensor:
    # about zero, not about the mean: zero is "nothing hidden" and has to stay where it is
    x = samples.double()
    return x.T @ x / len(x) + RIDGE * torch.eye(x.shape[1], dtype=torch.float64)


def _power(matrix: Tensor, exponent: float) -> Tensor:
    values, vectors = torch.linalg.eigh(matrix)
    return (vectors * values.clamp_min(1e-12) ** exponent) @ vectors.T
