from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import lightning
import numpy as np
import pytest
import torch

from tests.train.conftest import Setup
from wt.config import Method
from wt.errors import ConfigError
from wt.train import module
from wt.train.score import PairTensors

SetUp = Callable[[Method], Setup]


class Each(lightning.Callback):
    """Calls a function after every batch."""

    def __init__(self, function: Callable[[lightning.Trainer, object], None]) -> None:
        self._function = function

    def on_train_batch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule,
        outputs: object, batch: object, batch_idx: int,
    ) -> None:  # fmt: skip
        self._function(trainer, batch)


def test_a_step_is_a_batch_though_four_optimizers_step(set_up: SetUp, paper: Method) -> None:
    setup = set_up(paper)
    batch_of_step: list[tuple[int, int]] = []
    setup.callbacks.append(Each(lambda t, batch: batch_of_step.append((t.global_step, batch.step))))
    trainer = setup.run(5)
    assert trainer.global_step == 5
    assert batch_of_step == [(k + 1, k) for k in range(5)]
    taken = [o.state[p]["step"] for o in trainer.optimizers for p in o.param_groups[0]["params"]]
    assert set(map(float, taken)) == {5.0}  # each optimizer's own


def test_a_strategy_that_waits_for_all_gradients_is_refused(
    set_up: SetUp, paper: Method, tmp_path: Path
) -> None:
    setup = set_up(paper)
    trainer = lightning.Trainer(
        accelerator="cpu", devices=1, strategy="ddp", default_root_dir=tmp_path, logger=False
    )
    try:
        with pytest.raises(ConfigError, match="Unwrapped"):
            trainer.fit(setup.module, setup.data)
    finally:
        if torch.distributed.is_initialized():
            torch.distributed.destroy_process_group()


def test_optimizers_hold_every_trained_parameter_once(set_up: SetUp, plus: Method) -> None:
    ours = set_up(plus).module
    held = [p for o in ours.configure_optimizers()[0] for g in o.param_groups for p in g["params"]]
    trained = {p for p in ours.model.parameters() if p.requires_grad}
    assert len(held) == len(set(held)) == len(trained)
    assert set(held) == trained


def test_momentum_of_each_optimizer(set_up: SetUp, paper: Method) -> None:
    # Adam's defaults for the autoencoder; β₁ = 0.5 between adversaries (Radford et al. 2016)
    optimizers, _ = set_up(paper).module.configure_optimizers()
    betas = [o.param_groups[0]["betas"] for o in optimizers]
    assert betas == [(0.9, 0.999), (0.9, 0.999), (0.5, 0.9), (0.5, 0.9)]


def test_learning_rates_warm_up_and_fall_to_zero(
    set_up: SetUp, paper: Method, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "WARM_UP", 10)
    train = replace(paper.train, steps=30, batch=2, learning_rate=0.5, gan_learning_rate=0.25)
    setup, rates = set_up(replace(paper, train=train)), []
    setup.callbacks.append(
        Each(lambda t, _: rates.append([o.param_groups[0]["lr"] for o in t.optimizers]))
    )
    setup.run(30)
    k = np.arange(1, 31)  # after a step stands the rate of the next
    shape = np.minimum(1, (k + 1) / 10) * (1 + np.cos(np.pi * k / 30)) / 2
    expected = shape[:, None] * [0.5, 0.5, 0.25, 0.25]
    np.testing.assert_allclose(rates, expected, rtol=1e-9, atol=1e-15)


def test_average_follows_the_generator(set_up: SetUp, plus: Method) -> None:
    setup = set_up(plus)
    start = [p.detach().clone() for p in setup.module.average.parameters()]
    history: list[list[torch.Tensor]] = []
    setup.callbacks.append(Each(lambda *_: history.append([p.detach().clone() for p in current])))
    current = list(setup.module.model.to_real.parameters())
    setup.run(4)
    # decay 0.9: ā_k = 0.9 ā_{k−1} + 0.1 g_k
    expected = start
    for step in history:
        expected = [0.9 * a + 0.1 * g for a, g in zip(expected, step, strict=True)]
    for found, wanted in zip(setup.module.average.parameters(), expected, strict=True):
        torch.testing.assert_close(found.detach(), wanted)


def test_deployed_has_the_averaged_generator_and_shares_the_rest(
    set_up: SetUp, paper: Method, plus: Method
) -> None:
    ours, papers = set_up(plus).module, set_up(paper).module
    assert ours.deployed().to_real is ours.average
    assert ours.deployed().encoder is ours.model.encoder
    assert ours.model.to_real is not ours.average
    assert papers.deployed() is papers.model


def test_metrics_and_gradient_norms_are_there_after_a_step(set_up: SetUp, paper: Method) -> None:
    setup = set_up(paper)
    setup.run(3)
    assert {
        "vae/reconstruction", "vae/kl", "vae/blind_penalty", "vae/blind_error",
        "vae/domain_accuracy", "latent/mean_norm", "latent/active_std", "latent/noise_std",
        "gan/generator", "gan/discriminator", "gan/accuracy", "gan/cycle", "gan/identity",
    } <= set(setup.module.metrics)  # fmt: skip
    assert not any(value.requires_grad for value in setup.module.metrics.values())
    model = setup.module.model
    by_hand = [p.grad.numpy().ravel() for p in model.blind.parameters()]
    norms = setup.module.gradient_norms()
    assert set(norms) == {f"gradient/{g}" for g in ("vae", "blind", "generators", "judges")}
    expected = np.linalg.norm(np.concatenate(by_hand).astype(float))
    assert float(norms["gradient/blind"]) == pytest.approx(expected, rel=1e-5)


def test_validation_tells_what_the_encoder_keeps_and_what_translation_adds(
    set_up: SetUp, paper: Method
) -> None:
    setup = set_up(paper)
    model = setup.module.model
    std = model.frame.state.std
    pairs = PairTensors.of(setup.data.validation.translated, std, std)
    trainer = lightning.Trainer(
        accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False
    )
    (told,) = trainer.validate(setup.module, setup.data, verbose=False)
    frame, n = model.frame, model.spec.n_state
    x = frame.conditions(pairs.o, pairs.a)

    def decoded(outcome: torch.Tensor) -> float:
        z, _ = model.encoder(x, (outcome - pairs.o[:, :n]) / frame.change.std)
        s_next = pairs.o[:, :n] + model.decoder(x, z) * frame.change.std
        return float((((s_next - pairs.real_next) / pairs.state_std) ** 2).mean())

    with torch.no_grad():
        own, untranslated = decoded(pairs.real_next), decoded(pairs.sim_next)
    assert told["val/self_reconstruction"] == pytest.approx(own, rel=1e-4)
    assert told["val/untranslated"] == pytest.approx(untranslated, rel=1e-4)
    assert told["val/mse"] != pytest.approx(untranslated, rel=1e-3)
