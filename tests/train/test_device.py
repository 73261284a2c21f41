"""Where networks are trained."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from tests.baselines.toy import REAL, SIM, Toy
from tests.learning.test_toy_translation import NETS
from wt.baselines.base import find
from wt.config import Baselines, Method, Train
from wt.errors import ConfigError
from wt.train.device import beside, check, device_of, on, seeded
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.selection import Unpaired


@pytest.fixture
def two_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)


def test_a_cuda_device_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ConfigError, match="use auto or cpu"):
        check("cuda")
    check("auto")
    check("cpu")
    assert device_of("auto") == torch.device("cpu")


@pytest.mark.usefixtures("two_gpus")
def test_processes_are_spread_over_devices_by_index() -> None:
    for process, index in ((0, 0), (1, 1), (2, 0)):
        assert device_of("auto", process) == device_of("cuda", process)
        assert device_of("cuda", process) == torch.device("cuda", index)
    assert device_of("cpu", 1) == torch.device("cpu")
    assert device_of("auto", replayed=False) == torch.device("cpu")
    assert device_of("cuda", 1, replayed=False) == torch.device("cuda", 1)
    assert beside(torch.device("cuda", 1), 1) == torch.device("cuda", 0)
    assert beside(torch.device("cpu"), 1) == torch.device("cpu")


def test_generators_follow_the_device_and_repeat() -> None:
    with on(torch.device("cpu")):
        first, second = (torch.rand(3, generator=seeded(4)) for _ in range(2))
    assert torch.equal(first, second)
    assert seeded(0).device == torch.device("cpu")


def test_training_on_the_cpu_leaves_torch_as_it_is() -> None:
    with on(torch.device("cpu")):
        assert not torch.overrides._get_current_function_mode_stack()
    with on(torch.device("meta")):
        assert torch.zeros(1).device.type == "meta"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine")
def test_every_method_trains_on_cuda_and_leaves_what_the_cpu_reads(tmp_path: Path) -> None:
    toy = Toy(0.5)
    sim, real = toy.collect(SIM, 20, 0), toy.collect(REAL, 20, 1)
    selection = Unpaired(toy.collect(SIM, 3, 2), toy.collect(REAL, 3, 3))
    method = Method(nets=NETS, train=Train(steps=20, validate_every=10, batch=64, segment=2))
    device = device_of("cuda")
    with on(device):
        model = fit_world_model(TrainingInput(toy.spec, method, sim, real, selection, 0, tmp_path))
        assert {p.device for p in model.parameters()} == {device}
        for name in Baselines().names:
            baseline = find(name)(toy.spec, Baselines(steps=20, batch=64, width=16), 0, toy)
            baseline.train(sim, real, selection)
            baseline.nets.cpu()
    assert model.cpu().strength.device == torch.device("cpu")
