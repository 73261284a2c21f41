"""A toy world's data and a method so small that a whole training takes a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import lightning
import pytest
import torch

from tests.baselines.toy import REAL, SIM, Toy
from wt.config import Mean, Method, Nets, Train, TranslationConfig
from wt.nets.world_model import WorldModel
from wt.train.batches import Held, StepBatches, in_frame
from wt.train.data import TranslationData
from wt.train.mean_field import fit_normalizers
from wt.train.module import WorldTranslation
from wt.train.selection import Paired, Selection
from wt.types import Pairs, Transitions, TransitionSpec


@dataclass(frozen=True)
class World:
    """What :func:`wt.train.fit.fit_world_model` is given."""

    spec: TransitionSpec
    sim: Transitions
    real: Transitions
    pairs: Pairs

    @property
    def selection(self) -> Selection:
        """By these pairs."""
        return Paired(self.pairs, self.real.s_next.std(axis=0))


@pytest.fixture(scope="session")
def world() -> World:
    toy = Toy(0.0)
    return World(toy.spec, toy.collect(SIM, 20, 1), toy.collect(REAL, 20, 2), toy.pairs(10, 3))


@pytest.fixture
def paper() -> Method:
    return Method(
        nets=Nets(latent=4, width=16, depth=2, translator_width=16),
        train=Train(steps=40, batch=64, validate_every=10, log_every=5),
    )


@pytest.fixture
def plus(paper: Method) -> Method:
    """Every option that the paper does not have."""
    return replace(
        paper,
        mean=Mean(kind="mode", members=2, width=16, depth=1, steps=30, batch=64),
        translation=TranslationConfig(
            conditioned=True, adversarial="lsgan", cycle=5.0, identity=0.0, transport=True,
            anchored=True, average=0.9, reach=10.0,
        ),
    )  # fmt: skip


@dataclass
class Setup:
    """A module with its data, ready to be stepped by Lightning."""

    module: WorldTranslation
    data: TranslationData
    callbacks: list[lightning.Callback] = field(default_factory=list)

    @property
    def batches(self) -> StepBatches:
        """What one process trains on."""
        return StepBatches(*self.data._train)

    def run(self, steps: int) -> lightning.Trainer:
        """Train for so many batches, with nothing around."""
        trainer = lightning.Trainer(
            accelerator="cpu",
            max_epochs=1,
            limit_train_batches=steps,
            limit_val_batches=0,
            callbacks=self.callbacks,
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        trainer.fit(self.module, self.data)
        return trainer


@pytest.fixture
def set_up(world: World) -> Callable[[Method], Setup]:
    """Builds a module with random weights everywhere, also where networks start at zero."""

    def build(method: Method) -> Setup:
        torch.manual_seed(0)
        model = WorldModel(world.spec, method)
        with torch.no_grad():
            for net in (model.to_real, model.to_sim):
                torch.nn.init.normal_(net.net[-1].weight, std=0.1)
        fit_normalizers(model.frame, world.sim, world.real)
        model.frame.requires_grad_(False)
        data = in_frame(model.frame, world.sim, world.real)
        loaded = TranslationData(
            *map(Held, data),
            world.selection,
            batch=method.train.batch,
            latent=method.nets.latent,
            seed=0,
        )
        return Setup(WorldTranslation(world.spec, method, model), loaded)

    return build


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "fit"
