"""One training on two processes is the training on one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import torch.distributed

from tests.train.conftest import World
from wt.config import Device, Method
from wt.train.batches import DomainData, Held, StepBatches
from wt.train.device import device_of, on
from wt.train.fit import TrainingInput, fit_world_model

Seen = dict[int, dict[str, float]]


def curve(
    world: World, method: Method, devices: int, folder: Path, device: Device = "cpu"
) -> tuple[Seen, torch.nn.Module]:
    seen: Seen = {}

    def sink(values: Mapping[str, float], step: int) -> None:
        seen.setdefault(step, {}).update(values)

    method = replace(method, train=replace(method.train, devices=devices))
    with on(device_of(device)):
        model = fit_world_model(
            TrainingInput(world.spec, method, world.sim, world.real, world.selection, 0, folder),
            sink=sink,
        )
    return seen, model.cpu()


TWO_CUDA = pytest.mark.skipif(
    torch.cuda.device_count() < 2, reason="no two CUDA devices on this machine"
)


@pytest.mark.parametrize(
    ("which", "segment", "device"),
    [
        pytest.param("plus", 1, "cpu", marks=pytest.mark.long),
        ("plus", 3, "cpu"),
        ("paper", 1, "cpu"),
        *(
            pytest.param(which, segment, "cuda", marks=TWO_CUDA)
            for which, segment in (("plus", 1), ("plus", 3), ("paper", 1))
        ),
    ],
)
def test_the_curve_is_the_same_on_one_and_two_processes(
    which: str, segment: int, device: Device, world: World, tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:  # fmt: skip
    method: Method = request.getfixturevalue(which)
    method = replace(method, train=replace(method.train, segment=segment))
    alone, one = curve(world, method, 1, tmp_path / "one", device)
    together, two = curve(world, method, 2, tmp_path / "two", device)
    assert sorted(alone) == sorted(together)
    # a spread over the rows of a batch is no mean over them: each process has that of its share
    names = [name for name in alone[10] if name != "latent/active_std"]
    for step, values in alone.items():
        for name in names:
            if name in values:
                assert together[step][name] == pytest.approx(values[name], rel=1e-4, abs=1e-7)
    for kept, other in zip(one.parameters(), two.parameters(), strict=True):
        torch.testing.assert_close(kept, other, rtol=1e-3, atol=1e-5)
    assert not torch.distributed.is_initialized()


def test_the_parts_of_a_batch_are_the_batch() -> None:
    def numbered(offset: int) -> Held[DomainData]:
        rows = torch.arange(offset, offset + 100, dtype=torch.float32)[:, None]
        return Held(DomainData(rows, rows, rows))

    data = numbered(0), numbered(1000)
    whole = StepBatches(*data, 8, 3, 5).at(4)
    parts = [StepBatches(*data, 8, 3, 5, part=(rank, 2)).at(4) for rank in range(2)]
    for rank, part in enumerate(parts):
        assert torch.equal(part.vae[0].x, whole.vae[0].x[rank::2])
        assert torch.equal(part.gan[1].y, whole.gan[1].y[rank::2])
        assert torch.equal(part.noise, whole.noise[:, rank::2])
