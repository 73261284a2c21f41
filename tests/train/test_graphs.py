from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import pytest
import torch

from tests.train.conftest import World
from wt.config import Device, Method
from wt.train import graphs, phases
from wt.train.device import device_of, on
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.module import WorldTranslation


def test_each_loss_is_of_the_networks_as_they_then_are_and_moves_its_own() -> None:
    first, second = (torch.nn.Parameter(torch.tensor(v)) for v in (2.0, 3.0))
    first.grad = torch.tensor(100.0)

    def losses() -> Iterator[torch.Tensor]:
        yield first * second
        yield first * second

    for _ in graphs.gradients(losses(), [[first], [second]]):
        with torch.no_grad():
            first.fill_(5.0)
    assert float(first.grad) == 3.0
    assert second.grad is not None and float(second.grad) == 5.0


class Pretended:
    """In place of a device's graph: computes anew, into the memory that a graph would write."""

    owner: ClassVar[graphs.Graphs]
    losses: ClassVar[Iterator[torch.Tensor]]
    metrics: ClassVar[dict[str, torch.Tensor]]

    def __init__(self) -> None:
        self.number, self.replays = len(self.owner._graphs), 0

    def replay(self) -> None:
        self.replays += 1
        if self.replays == 1:  # what was recorded on a CPU was computed as well
            return
        owner = self.owner
        if self.number == 0:
            assert owner._batch is not None
            Pretended.metrics = {}
            Pretended.losses = owner._losses(owner._batch, Pretended.metrics)
        new = torch.autograd.grad(next(self.losses), owner._each[self.number])
        for held, gradient in zip(owner._held[self.number], new, strict=True):
            assert held is not None
            held.copy_(gradient)
        for name, value in self.metrics.items():
            owner._metrics[name].copy_(value)


@pytest.fixture
def pretended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have steps recorded and replayed on the CPU."""

    def begin(module: WorldTranslation) -> None:
        if module.model.method.train.cuda_graphs:
            losses = partial(phases.iteration, module.model)
            module._graphs = Pretended.owner = graphs.Graphs(losses, module._each)

    cuda = SimpleNamespace(
        CUDAGraph=Pretended, graph=lambda *_, **__: nullcontext(), graph_pool_handle=lambda: None
    )
    monkeypatch.setattr(graphs, "torch", SimpleNamespace(cuda=cuda))
    monkeypatch.setattr(WorldTranslation, "on_train_start", begin)


Curve = list[dict[str, float]]


def curve(world: World, method: Method, folder: Path, used: bool, device: Device) -> Curve:
    rows: Curve = []

    def sink(metrics: Mapping[str, float], step: int) -> None:
        rows.append({"step": step, **metrics})

    method = replace(method, train=replace(method.train, cuda_graphs=used))
    with on(device_of(device)):
        fit_world_model(
            TrainingInput(world.spec, method, world.sim, world.real, world.selection, 0, folder),
            sink=sink,
        )
    return rows


@pytest.mark.usefixtures("pretended")
def test_what_is_replayed_is_what_would_be_computed(
    world: World, plus: Method, tmp_path: Path
) -> None:
    # 40 steps, of which every tenth is followed by a validation
    eager, replayed = (curve(world, plus, tmp_path / str(b), b, "cpu") for b in (False, True))
    assert len(Pretended.owner._graphs) == 4
    assert replayed == eager


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize("segment", [1, 2])
def test_graphs_train_as_without_them(
    world: World, plus: Method, tmp_path: Path, segment: int
) -> None:
    method = replace(plus, train=replace(plus.train, segment=segment))
    eager, graphed = (curve(world, method, tmp_path / str(b), b, "cuda") for b in (False, True))
    assert [set(row) for row in graphed] == [set(row) for row in eager]
    for now, then in zip(graphed, eager, strict=True):
        assert now == pytest.approx(then, rel=1e-3, abs=1e-5)
