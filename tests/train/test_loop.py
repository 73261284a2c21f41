"""Devices and machines that one model is trained on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from wt.config import Train
from wt.errors import ConfigError, UserError
from wt.train.loop import refuse_absent

CUDA = torch.device("cuda", 0)

_TWO_MACHINES = """
import os
import sys
from dataclasses import replace
from pathlib import Path

import torch
from ray.cluster_utils import Cluster

from tests.baselines.toy import REAL, SIM, Toy
from wt.config import Method, Nets, Train
from wt.errors import UserError
from wt.train.fit import TrainingInput, fit_world_model
from wt.train.loop import refuse_absent
from wt.train.selection import Unpaired

folder, toy = Path(sys.argv[1]), Toy(0.0)
data = toy.collect(SIM, 20, 1), toy.collect(REAL, 20, 2)
selection = Unpaired(toy.collect(SIM, 3, 3), toy.collect(REAL, 3, 4))
train = Train(steps=20, batch=64, validate_every=10, log_every=5)
method = Method(nets=Nets(latent=4, width=16, depth=2, translator_width=16), train=train)


def trained(name, **changes):
    changed = replace(method, train=replace(train, **changes))
    curve = {}
    model = fit_world_model(
        TrainingInput(toy.spec, changed, *data, selection, 0, folder / name),
        sink=lambda values, step: curve.setdefault(step, {}).update(values),
    )
    return curve, model


def same(curve, other, steps):
    assert [step for step in other if step > steps] == [step for step in curve if step > steps]
    for step, values in other.items():
        for name in set(values) - {"latent/active_std"}:  # a spread is no mean over shares
            one = curve[step][name]
            assert abs(values[name] - one) <= 1e-4 * abs(one) + 1e-6, (step, name)


if __name__ == "__main__":
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    cluster.add_node(num_cpus=2)
    os.environ["RAY_ADDRESS"] = cluster.address
    try:
        refuse_absent(replace(train, nodes=3), torch.device("cpu"))
    except UserError as error:
        assert "and 2 of the Ray cluster with enough cores (1), which has 1;" in str(error), error
    else:
        raise AssertionError("there are no three machines")
    curve, alone = trained("alone")
    other, together = trained("together", nodes=2, strategy="ray")
    same(curve, other, 0)
    for one, two in zip(alone.parameters(), together.parameters(), strict=True):
        torch.testing.assert_close(one, two, rtol=1e-3, atol=1e-5)
    # what was begun by one process is finished by two machines, one of which has no folder of it
    trained("resumed", steps=10)
    other, _ = trained("resumed", nodes=2, devices=2)
    assert min(step for step in other) > 10 and max(other) == 20
    cluster.shutdown()
"""


def test_more_devices_than_there_are_are_refused_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    refuse_absent(Train(devices=2), CUDA)
    refuse_absent(Train(devices=4), torch.device("cpu"))  # processes on its cores
    with pytest.raises(ConfigError, match=r"train\.devices is 4; this machine has 2 CUDA devices"):
        refuse_absent(Train(devices=4), CUDA)


def test_other_machines_need_the_address_of_a_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with pytest.raises(UserError, match=r"set RAY_ADDRESS to its address, or train\.nodes to 1"):
        refuse_absent(Train(nodes=2), torch.device("cpu"))


@pytest.mark.long
def test_the_curve_is_the_same_on_one_and_two_machines(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    script = tmp_path / "two_machines.py"
    script.write_text(_TWO_MACHINES)
    root = Path(__file__).parents[2]
    env = {**os.environ, "PYTHONPATH": str(root), "RAY_USAGE_STATS_ENABLED": "0"}
    ended = subprocess.run(
        [sys.executable, script, tmp_path], cwd=root, env=env, capture_output=True, text=True,
        timeout=300,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
