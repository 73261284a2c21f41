"""What is the same whatever is hidden: regressors n and δ, and the linear transport.

``n`` imitates the simulator with nothing hidden, so that an exported graph can tell from
(o, a, o′) what the hidden variable did. ``δ`` is what R does differently then. Where the hidden
variable is often absent, δ is the most frequent difference rather than the average one
(``mean.kind: mode``): the average is biased by whatever (o, a) gives away of the hidden variable.

Where it is never absent there is no answer with nothing hidden, and ``n`` is S's average answer
instead (``mean.simulator: mean``). Beside it, regressors that read S's answer may have a share of
the prediction (``mean.simulator: blend``).
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor, nn

from wt.config import Mean
from wt.losses.robust import cauchy
from wt.nets.frame import Frame
from wt.nets.mlp import Ensemble
from wt.train.device import seeded
from wt.train.regression import Progress, Regression, Score, mean_square, regress
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


def fit_mean_field(
    frame: Frame,
    sim: Transitions,
    real: Transitions,
    settings: Mean,
    seed: int,
    progress: Progress | None = None,
    score: Score | None = None,
    nominal_score: Score | None = None,
    reader_score: Score | None = None,
) -> None:
    """Train n on the simulator and δ on R against it; nothing for kind ``none``.

    Args:
        frame: a frame with fitted normalisers; its regressors are trained in place.
        sim: transitions of S; read are (o, a) and the nominal answer, or what came out.
        real: transitions of R.
        settings: kind and budget.
        seed: same seed, same regressors.
        progress: called with (done, total) steps.
        score: error on validation pairs, which stops δ from being over-trained.
        nominal_score: the same for n.
        reader_score: the same for the regressors that read S's answer.
    """
    if frame.shift is None:
        return
    x_real, nominal_real, r_real = _tensors(frame, real)
    n_real = nominal_real
    total, done = regressions(settings) * settings.steps, 0
    if frame.nominal is None:
        n_real = torch.zeros_like(n_real)
    else:
        x_sim, n_sim, s_sim = _tensors(frame, sim)
        nominal, x, n = frame.nominal, torch.cat([x_sim, x_real]), torch.cat([n_sim, n_real])
        if settings.averages:
            x, n = x_sim, s_sim
        regress(
            nominal,
            lambda rows: nominal(x[rows]) - n[rows],
            len(x),
            _budget(settings, seed),
            progress=_after(progress, done, total),
            score=nominal_score,
        )
        done += settings.steps
        if settings.averages:
            n_real = _answers(nominal, x_real)
    inputs = torch.cat([x_real, n_real], dim=1) if frame.reads_simulator else x_real
    jobs = [(frame.shift, inputs, r_real - n_real, score)]
    if frame.reader is not None:
        answers = torch.cat([x_real, nominal_real], dim=1)
        jobs.append((frame.reader, answers, r_real - nominal_real, reader_score))
    for ensemble, reads, target, judged in jobs:
        for k, alone in _one_by_one(ensemble):
            _fit_member(alone, reads, target, settings, seed + 1000 * k,
                        _after(progress, done, total), judged)  # fmt: skip
            done += settings.steps
    frame.requires_grad_(False)


def regressions(settings: Mean) -> int:
    """How many regressions of ``settings.steps`` each a mean field takes."""
    if settings.kind == "none":
        return 0
    ensembles = 2 if settings.simulator == "blend" else 1
    return ensembles * settings.members + (settings.simulator != "ignored")


def _one_by_one(ensemble: Ensemble) -> Iterator[tuple[int, nn.Module]]:
    """Each member, as the ensemble's only one: the others would hide what it scores."""
    members = list(ensemble.members)
    for k, member in enumerate(members):
        ensemble.members = nn.ModuleList([member])
        yield k, member
    ensemble.members = nn.ModuleList(members)


def _fit_member(
    member: nn.Module,
    inputs: Tensor,
    target: Tensor,
    settings: Mean,
    seed: int,
    progress: Progress | None,
    score: Score | None,
) -> None:
    """Train one regressor of δ."""
    noise = seeded(seed)

    def error(rows: Tensor) -> Tensor:
        x = inputs[rows]
        if settings.input_noise:
            x = x + settings.input_noise * torch.randn(x.shape, generator=noise)
        return member(x) - target[rows]

    def mode(error: Tensor, done: float) -> Tensor:
        return cauchy(error, settings.mode_width)

    loss = mode if settings.kind == "mode" else mean_square
    regress(member, error, len(inputs), _budget(settings, seed), loss, progress, score)


def _budget(settings: Mean, seed: int) -> Regression:
    return Regression(settings.steps, settings.batch, settings.learning_rate, seed)


def _after(progress: Progress | None, done: int, total: int) -> Progress | None:
    """Progress of one regression among several."""
    return progress and (lambda k, _: progress(done + k, total))


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


@torch.no_grad()
def _answers(net: nn.Module, x: Tensor) -> Tensor:
    """A regressor's answers, (N, channels), a part at a time."""
    return torch.cat([net(part) for part in x.split(8192)])


@torch.no_grad()
def _tensors(frame: Frame, data: Transitions) -> tuple[Tensor, Tensor, Tensor]:
    """Normalised condition, nominal change and actual change."""
    o = torch.tensor(data.o)
    x = frame.conditions(o, torch.tensor(data.a))
    nominal = frame.changes(o, torch.tensor(data.nominal))
    return x, nominal, frame.changes(o, torch.tensor(data.s_next))
