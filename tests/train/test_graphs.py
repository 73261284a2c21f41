from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.train.conftest import World
from wt.config import Method
from wt.train import graphs
from wt.train.device import on
from wt.train.fit import fit_world_model


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


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize("segment", [1, 2])
def test_graphs_train_as_without_them(
    world: World, plus: Method, tmp_path: Path, segment: int
) -> None:
    curves: dict[bool, list[dict[str, float]]] = {}
    for used in (False, True):
        rows = curves[used] = []

        def sink(metrics: Mapping[str, float], step: int, rows: list = rows) -> None:
            rows.append({"step": step, **metrics})

        train = replace(plus.train, cuda_graphs=used, segment=segment)
        method = replace(plus, train=train)
        with on("cuda"):
            fit_world_model(
                world.spec, method, world.sim, world.real, world.selection, 0,
                tmp_path / str(used), sink=sink,
            )  # fmt: skip
    assert [set(row) for row in curves[True]] == [set(row) for row in curves[False]]
    for graphed, eager in zip(curves[True], curves[False], strict=True):
        assert graphed == pytest.approx(eager, rel=1e-3, abs=1e-5)
