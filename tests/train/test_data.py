"""The data module and the checkpoint, as somebody who knows Lightning uses them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import lightning
import pytest
import torch

from tests.train.conftest import Setup, World
from wt.config import Method
from wt.train.data import TranslationData
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.module import WorldTranslation
from wt.train.score import PairTensors, predictions, score
from wt.types import Pairs

SetUp = Callable[[Method], Setup]


def trainer() -> lightning.Trainer:
    return lightning.Trainer(
        accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False, limit_train_batches=3, max_epochs=2, num_sanity_val_steps=0,
    )  # fmt: skip


def test_every_loader_gives_what_it_is_named_after(set_up: SetUp, paper: Method) -> None:
    setup, seen = set_up(paper), []

    class Steps(lightning.Callback):
        def on_train_batch_start(self, trainer: object, module: object, batch: object,
                                 batch_idx: int) -> None:  # fmt: skip
            seen.append(batch.step)  # type: ignore[attr-defined]

    run = trainer()
    run.callbacks.append(Steps())
    run.fit(setup.module, setup.data)
    assert seen == [0, 1, 2, 3, 4, 5]  # though a batch more is fetched at an epoch's end
    (validation,) = setup.data.val_dataloader()
    assert validation is setup.data.validation
    (told,) = trainer().validate(setup.module, setup.data, verbose=False)
    wanted = score(setup.module.deployed(), setup.data.validation)
    assert told["val/mse"] == pytest.approx(wanted, rel=1e-5)


def test_the_trainer_tests_on_pairs_that_chose_nothing(
    set_up: SetUp, paper: Method, world: World
) -> None:
    setup = set_up(paper)
    with pytest.raises(RuntimeError, match="no test pairs"):
        setup.data.test_dataloader()
    sim, real, batch, latent, seed, _ = setup.data._train
    data = TranslationData(
        sim, real, world.selection, batch=batch, latent=latent, seed=seed, test=world.pairs
    )
    (told,) = trainer().test(setup.module, datamodule=data, verbose=False)
    states = predictions(setup.module.deployed(), pair_tensors(setup, world.pairs)).numpy()
    frame, wanted = setup.module.model.frame, world.pairs.real.s_next
    for name, unit in (("mse", frame.state.std), ("mse_change", frame.change.std)):
        error = (((states - wanted) / unit.numpy()) ** 2).mean()
        assert told[f"test/{name}"] == pytest.approx(error, rel=1e-5)


def pair_tensors(setup: Setup, pairs: Pairs) -> PairTensors:
    frame = setup.module.model.frame
    return PairTensors.of(pairs, frame.state.std, frame.change.std)


@pytest.mark.parametrize("which", ["paper", "plus"])
def test_a_checkpoint_is_loaded_without_anything_else(
    which: str, world: World, folder: Path, request: pytest.FixtureRequest
) -> None:
    method = request.getfixturevalue(which)
    fit_world_model(
        TrainingInput(world.spec, method, world.sim, world.real, world.selection, 0, folder)
    )
    loaded = WorldTranslation.load_from_checkpoint(folder / "last.ckpt", weights_only=True)
    assert loaded.model.spec == world.spec and loaded.model.method == method
    checkpoint = torch.load(folder / "last.ckpt", weights_only=True)
    assert checkpoint["global_step"] == 40
    kept = checkpoint["state_dict"]
    assert all(torch.equal(value, kept[name]) for name, value in loaded.state_dict().items())
