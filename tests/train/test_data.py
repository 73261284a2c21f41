"""The data module and the checkpoint, as somebody who knows Lightning uses them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import lightning
import pytest
import torch

from tests.train.conftest import Setup, World
from wt.config import Method
from wt.train.fit import fit_world_model
from wt.train.module import WorldTranslation
from wt.train.score import score

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


@pytest.mark.parametrize("which", ["paper", "plus"])
def test_a_checkpoint_is_loaded_without_anything_else(
    which: str, world: World, folder: Path, request: pytest.FixtureRequest
) -> None:
    method = request.getfixturevalue(which)
    fit_world_model(world.spec, method, world.sim, world.real, world.selection, 0, folder)
    loaded = WorldTranslation.load_from_checkpoint(folder / "last.ckpt", weights_only=True)
    assert loaded.own_step == 40
    assert loaded.model.spec == world.spec and loaded.model.method == method
    kept = torch.load(folder / "last.ckpt", weights_only=True)["state_dict"]
    assert all(torch.equal(value, kept[name]) for name, value in loaded.state_dict().items())
