from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import lightning
import numpy as np
import pytest
import torch
from torch import nn

from tests.train.conftest import Setup
from wt.config import Method, Vae
from wt.nets.world_model import WorldModel
from wt.train import phases
from wt.train.batches import StepBatch

SetUp = Callable[[Method], Setup]


def snapshot(model: nn.Module) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in model.state_dict().items()}


def moved(before: dict[str, torch.Tensor], after: dict[str, torch.Tensor]) -> set[str]:
    """Names of the networks that differ."""
    return {k.split(".")[0] for k in before if not torch.equal(before[k], after[k])}


class Snapshots(lightning.Callback):
    """The model before every optimizer step, and at the end."""

    def __init__(self) -> None:
        self.taken: list[dict[str, torch.Tensor]] = []

    def on_before_optimizer_step(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule,
        optimizer: torch.optim.Optimizer,
    ) -> None:  # fmt: skip
        self.taken.append(snapshot(pl_module.model))

    def on_train_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        self.taken.append(snapshot(pl_module.model))


@pytest.mark.parametrize("which", ["paper", "plus"])
def test_each_update_moves_its_own_networks_only(
    which: str, set_up: SetUp, request: pytest.FixtureRequest
) -> None:
    setup, snapshots = set_up(request.getfixturevalue(which)), Snapshots()
    setup.callbacks.append(snapshots)
    setup.run(2)
    moves = [moved(a, b) for a, b in zip(snapshots.taken[:-1], snapshots.taken[1:], strict=True)]
    once = [
        {"encoder", "decoder", "classifier"},
        {"blind"},
        {"to_real", "to_sim"},
        {"discriminator_real", "discriminator_sim"},
    ]
    assert moves == once + once


def with_gradient(model: WorldModel, loss: torch.Tensor) -> set[str]:
    """Names of the networks that a loss would change."""
    model.zero_grad()
    loss.backward()
    return {n.split(".")[0] for n, p in model.named_parameters() if p.grad is not None}


def test_losses_reach_no_further_than_they_should(set_up: SetUp, paper: Method) -> None:
    setup = set_up(paper)
    model, batch = setup.module.model, setup.batches.at(0)
    loss, _, z = phases.extraction(model, batch)
    # the blind decoder is reached on the way to the encoder; its optimizer does not step here
    assert with_gradient(model, loss) == {"encoder", "decoder", "classifier", "blind"}
    loss, _, z = phases.extraction(model, batch)
    assert z.requires_grad
    assert with_gradient(model, phases.blind(model, batch, z)[0]) == {"blind"}
    z_sim, z_real = phases.encode(model, batch)
    loss, _, fakes = phases.generators(model, batch.gan, z_sim, z_real)
    translators = {"to_real", "to_sim", "discriminator_real", "discriminator_sim"}
    assert with_gradient(model, loss) == translators
    loss, _ = phases.discriminators(model, batch.gan, z_sim, z_real, fakes)
    assert with_gradient(model, loss) == {"discriminator_real", "discriminator_sim"}


class Answers(nn.Module):
    """Gives a fixed answer, whatever it is asked."""

    def __init__(self, *answer: torch.Tensor) -> None:
        super().__init__()
        self.answer = answer if len(answer) > 1 else answer[0]

    def forward(self, *asked: torch.Tensor) -> torch.Tensor | Sequence[torch.Tensor]:
        return self.answer


def stacked(batch: StepBatch, name: str) -> torch.Tensor:
    return torch.cat([getattr(side, name) for side in batch.vae])


def test_extraction_weighs_its_four_terms(set_up: SetUp, paper: Method) -> None:
    weights = Vae(beta=0.3, blind_weight=0.7, blind_temperature=2.0, classifier_weight=1.1)
    setup = set_up(replace(paper, vae=weights))
    model, batch = setup.module.model, setup.batches.at(0)
    n = len(batch.vae[0].x)
    mean = torch.linspace(-1, 1, 2 * n * 4).reshape(2 * n, 4)
    model.encoder = Answers(mean, torch.full_like(mean, -1.0))
    model.decoder = Answers(stacked(batch, "y") + 0.1)
    model.blind = Answers(stacked(batch, "s_next") - 0.5)
    logits = torch.cat([torch.full((n,), -2.0), torch.full((n,), 3.0)])
    model.classifier = Answers(logits)
    loss, metrics, z = phases.extraction(model, batch)
    kl = 0.5 * (mean.numpy() ** 2 + np.exp(-1) + 1.0 - 1.0).sum(axis=1).mean()
    bce = 0.5 * (np.log1p(np.exp(-2.0)) + np.log1p(np.exp(-3.0)))
    # the prior's weight is that of one channel's error, however many channels there are
    expected = 4 * 0.1**2 + 0.3 * kl + 0.7 * np.exp(-(0.5**2) / 2.0**2) + 1.1 * bce
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    assert float(metrics["vae/domain_accuracy"]) == 1.0
    assert float(metrics["latent/noise_std"]) == pytest.approx(np.exp(-0.5), rel=1e-6)
    assert float(metrics["latent/active_std"]) == pytest.approx(float(mean.std(dim=0).mean()))
    # z = μ + σ ε, with its own noise for each domain
    noise = batch.noise[:2].flatten(0, 1)
    torch.testing.assert_close(z, mean + np.exp(-0.5).item() * noise)


def test_translation_draws_noise_of_its_own(set_up: SetUp, paper: Method) -> None:
    setup = set_up(paper)
    model, batch = setup.module.model, setup.batches.at(0)
    zeros = torch.zeros_like(batch.noise[0])
    model.encoder = Answers(zeros, zeros)  # z = ε
    z_sim, z_real = phases.encode(model, batch)
    assert torch.equal(z_sim, batch.noise[2]) and torch.equal(z_real, batch.noise[3])


def test_blind_error_is_on_the_next_state_itself(set_up: SetUp, paper: Method) -> None:
    setup = set_up(paper)
    model, batch = setup.module.model, setup.batches.at(0)
    model.blind = Answers(stacked(batch, "s_next") - 0.5)
    loss, _ = phases.blind(model, batch, torch.zeros(len(stacked(batch, "x")), 4))
    assert float(loss) == pytest.approx(4 * 0.5**2)


class Shift(nn.Module):
    """A generator that adds a constant."""

    def __init__(self, by: float) -> None:
        super().__init__()
        self.by = by

    def forward(self, z: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        return z + self.by


class Sum(nn.Module):
    """A discriminator whose logit is the sum of the features."""

    def forward(self, z: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        return z.sum(-1)


def test_translation_losses_of_known_generators(set_up: SetUp, paper: Method) -> None:
    setup = set_up(paper)
    model, batch = setup.module.model, setup.batches.at(0)
    model.to_real, model.to_sim = Shift(2.0), Shift(-0.5)
    model.discriminator_real, model.discriminator_sim = Sum(), Sum()
    z_sim, z_real = torch.randn(64, 4), torch.randn(64, 4)
    loss, metrics, fakes = phases.generators(model, batch.gan, z_sim, z_real)
    torch.testing.assert_close(fakes, (z_sim + 2.0, z_real - 0.5))
    logits = [f.numpy().astype(float).sum(axis=1) for f in fakes]
    adversarial = sum(np.log1p(np.exp(-x)).mean() for x in logits)
    # both cycles end 1.5 off; identity: G_R on R is 2 off, G_S on S 0.5
    assert float(metrics["gan/cycle"]) == pytest.approx(3.0, rel=1e-5)
    assert float(metrics["gan/identity"]) == pytest.approx(2.5, rel=1e-5)
    assert float(metrics["gan/generator"]) == pytest.approx(adversarial, rel=1e-5)
    weights = paper.translation
    expected = adversarial + 3.0 * weights.cycle + 2.5 * weights.identity
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    loss, metrics = phases.discriminators(model, batch.gan, z_sim, z_real, fakes)
    real = [z.numpy().astype(float).sum(axis=1) for z in (z_real, z_sim)]
    expected = sum(np.log1p(np.exp(-x)).mean() for x in real)
    expected += sum(np.log1p(np.exp(x)).mean() for x in logits)
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    right = [(x > 0).mean() for x in real] + [(x <= 0).mean() for x in logits]
    assert float(metrics["gan/accuracy"]) == pytest.approx(np.mean(right))


def test_conditioned_translation_sees_the_condition_that_belongs_to_it(
    set_up: SetUp, plus: Method
) -> None:
    setup = set_up(plus)
    model, batch = setup.module.model, setup.batches.at(0)
    seen: dict[str, list[torch.Tensor]] = {}

    def note(name: str) -> Callable[..., None]:
        def hook(net: nn.Module, given: tuple[torch.Tensor, torch.Tensor], out: object) -> None:
            seen.setdefault(name, []).append(given[1])

        return hook

    for name in ("to_real", "to_sim", "discriminator_real", "discriminator_sim"):
        getattr(model, name).register_forward_hook(note(name))
    z = phases.encode(model, batch)
    _, _, fakes = phases.generators(model, batch.gan, *z)
    phases.discriminators(model, batch.gan, *z, fakes)
    x_sim, x_real = (side.x for side in batch.gan)
    # what comes from S keeps S's (o, a), there and back
    expected = {
        "to_real": [x_sim, x_real],
        "to_sim": [x_real, x_sim],
        "discriminator_real": [x_sim, x_real, x_sim],
        "discriminator_sim": [x_real, x_sim, x_real],
    }
    for name, conditions in expected.items():
        assert len(seen[name]) == len(conditions), name
        assert all(torch.equal(a, b) for a, b in zip(seen[name], conditions, strict=True)), name
