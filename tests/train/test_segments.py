from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from tests.train.conftest import World
from wt.config import Method, Online
from wt.nets.world_model import WorldModel
from wt.train.batches import DomainData
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.mean_field import fit_normalizers
from wt.train.online import OnlineAdaptation
from wt.train.score import PairTensors, errors
from wt.train.segments import Segments, segment_error
from wt.train.translation_only import OutcomeTranslator, train_translation


def test_segments_stay_inside_their_episode(world: World) -> None:
    segments = Segments(world.real, 5, 100)
    drawn = segments.draw(torch.Generator().manual_seed(0))
    assert drawn is not None
    assert drawn.o.shape == (20, 5, 6)
    # the next observation begins with this step's outcome and ends with its action
    assert torch.allclose(drawn.o[:, 1:, :4], drawn.s_next[:, :-1], atol=1e-6)
    assert torch.allclose(drawn.o[:, 1:, 4:], drawn.a[:, :-1], atol=1e-6)
    assert Segments(world.real, 61, 100).draw(torch.Generator()) is None  # episodes have 60


def test_errors_add_up_along_a_segment(world: World, paper: Method) -> None:
    """A decoder that is off by e at each step is off by (k + 1) e after k more."""
    model = WorldModel(world.spec, paper)
    fit_normalizers(model.frame, world.sim, world.real)
    drawn = Segments(world.real, 3, 30).draw(torch.Generator().manual_seed(1))
    assert drawn is not None
    truth = iter([(drawn.s_next[:, k] - drawn.o[:, k, :4]) / model.frame.change.std
                  for k in range(3)])  # fmt: skip

    class Off(nn.Module):
        def forward(self, x: Tensor, z: Tensor) -> Tensor:
            return next(truth) + 0.1

    model.decoder = Off()
    found = float(segment_error(model, drawn).detach())
    assert np.isclose(found, 4 * (0.2**2 + 0.3**2) / 2, rtol=1e-3)  # a sum over four channels


@pytest.mark.long
def test_training_on_segments_lowers_their_error(
    world: World, paper: Method, tmp_path: Path
) -> None:
    drawn = Segments(world.real, 6, 240).draw(torch.Generator().manual_seed(5))
    assert drawn is not None
    found = []
    for length in (1, 6):
        train = replace(paper.train, segment=length, steps=100)
        model = fit_world_model(
            TrainingInput(
                world.spec,
                replace(paper, train=train),
                world.sim,
                world.real,
                world.selection,
                0,
                tmp_path / str(length),
            )
        )
        found.append(float(segment_error(model, drawn).detach()))
    assert found[1] < found[0]


def test_a_stream_teaches_a_model_what_changed(world: World, paper: Method, tmp_path: Path) -> None:
    online = Online(iterations=30, memory=1000, learning_rate=3e-3)
    settings = replace(paper, online=online)
    model = fit_world_model(
        TrainingInput(world.spec, settings, world.sim, world.sim, world.selection, 0, tmp_path)
    )
    before = {name: value.clone() for name, value in model.state_dict().items()}
    pairs = PairTensors.of(world.pairs, torch.ones(4), torch.ones(4))
    adaptation = OnlineAdaptation(model, world.sim, 0)
    at_first = errors(adaptation.model, pairs)[0]
    for rows in np.array_split(np.arange(len(world.real)), 4):
        adaptation.learn(world.real.select(rows))
    # it was trained on S in both roles: only the stream tells what R is
    assert errors(adaptation.model, pairs)[0] < 0.9 * at_first
    assert all(torch.equal(before[name], value) for name, value in model.state_dict().items())


def test_without_iterations_nothing_adapts(world: World, paper: Method) -> None:
    model = WorldModel(world.spec, paper)
    fit_normalizers(model.frame, world.sim, world.real)
    adaptation = OnlineAdaptation(model, world.sim, 0)
    adaptation.learn(world.real)
    same = zip(model.parameters(), adaptation.model.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in same)


def domains(leak: float) -> tuple[DomainData, DomainData]:
    generator = torch.Generator().manual_seed(0)
    found = []
    for side in (-1.0, 1.0):
        x, y = (torch.randn(2000, 2, generator=generator) for _ in range(2))
        found.append(DomainData(x + leak * side, y + 0.5 * side, y))
    return found[0], found[1]


def told_apart(paper: Method, condition: int, leak: float) -> tuple[float, OutcomeTranslator]:
    train = replace(paper.train, steps=300, gan_learning_rate=2e-3, log_every=20)
    torch.manual_seed(0)
    model = OutcomeTranslator(2, condition, replace(paper, train=train))
    seen = train_translation(model, *domains(leak), 0)
    assert seen.step[-1] == 300
    return float(np.mean(seen.accuracy[-5:])), model


@pytest.mark.long
def test_translation_of_observations_collapses_where_conditions_tell_the_domain(
    paper: Method,
) -> None:
    features, model = told_apart(paper, 0, 4.0)
    z = torch.zeros(100, 2)
    moved = model.to_real(z - 0.5, z).detach().mean()
    assert float(moved) > -0.5  # towards R, at +0.5
    # with them, the discriminators need not look at y at all
    assert told_apart(paper, 2, 4.0)[0] > 0.95 > features + 0.1
