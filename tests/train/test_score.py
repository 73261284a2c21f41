from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.train.conftest import World
from wt.config import Method
from wt.nets.world_model import WorldModel
from wt.train import score
from wt.train.mean_field import fit_normalizers
from wt.train.score import PairTensors, errors, predictions


@pytest.fixture
def model(world: World, paper: Method) -> WorldModel:
    torch.manual_seed(0)
    model = WorldModel(world.spec, paper)
    fit_normalizers(model.frame, world.sim, world.real)
    return model


def test_errors_of_an_untouched_simulator_are_rawsims(
    world: World, model: WorldModel, paper: Method
) -> None:
    # anchored and without a mean field, an identity generator changes nothing
    model.method = replace(paper, translation=replace(paper.translation, anchored=True))
    real = world.real.s_next.astype(float)
    state_std = real.std(axis=0)
    change_std = (real - world.real.o[:, :4]).std(axis=0)
    pairs = PairTensors.of(world.pairs, torch.tensor(state_std), torch.tensor(change_std))
    gap = world.pairs.sim_next.astype(float) - world.pairs.real.s_next
    mse, mse_change = errors(model, pairs)
    assert mse == pytest.approx(np.mean((gap / state_std) ** 2), rel=1e-4)
    assert mse_change == pytest.approx(np.mean((gap / change_std) ** 2), rel=1e-4)


def test_chunks_make_no_difference(
    world: World, model: WorldModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = PairTensors.of(world.pairs, torch.ones(4), torch.ones(4))
    whole = predictions(model, pairs)
    assert whole.shape == (len(world.pairs), 4) and not whole.requires_grad
    monkeypatch.setattr(score, "CHUNK", 7)
    torch.testing.assert_close(predictions(model, pairs), whole)
