"""Models of the Go2's task whose answer is known: R is S, moved by a constant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from registry.card import HeldOut, describe
from registry.push import push
from wt import track
from wt.finetune.config import Finetune, load
from wt.finetune.setting import Setting
from wt.types import TransitionSpec

MakeModel = Callable[..., Path]

TINY = [
    "training.robots=4", "training.threads=1", "training.ppo.iterations=2", "training.ppo.steps=4",
    "seeds=[0]", "warm_up=1", "evaluation.episodes=2", "evaluation.commands=[[0.2,0,0,0.5]]",
]  # fmt: skip


@pytest.fixture(autouse=True)
def in_the_checkout(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Configurations name each other from there."""
    monkeypatch.chdir(root)


@pytest.fixture
def tiny(root: Path) -> Finetune:
    return load(root / "conf" / "finetune_go2.yaml", TINY)


@pytest.fixture
def setting(tiny: Finetune) -> Setting:
    return Setting.of(tiny)


@pytest.fixture
def make_model(tmp_path: Path, setting: Setting) -> MakeModel:
    """Makes a folder with ``model.onnx`` and ``card.json``."""

    def make(shift: float = 0.01, **changes: object) -> Path:
        spec = replace(setting.world().spec, **changes)
        folder = tmp_path / f"model-{len(list(tmp_path.glob('model-*')))}"
        folder.mkdir()
        onnx.save(_graph(spec, shift), folder / "model.onnx")
        rng = np.random.default_rng(0)
        widths = (spec.n_obs, spec.n_action, spec.n_obs)
        o, a, s = (rng.normal(size=(2, width)).astype(np.float32) for width in widths)
        describe(
            folder / "model.onnx",
            spec,
            name="wt-toy",
            data_hash="data",
            config_hash="config",
            commit="0" * 40,
            metrics={},
            heldout=HeldOut("test pairs", "data", "mse", 0.5),
            parity=0.0,
            golden=(o, a, s, s + np.float32(shift)),
        ).save(folder)
        return folder

    return make


@pytest.fixture
def registered(tmp_path: Path, make_model: MakeModel) -> Callable[..., list[str]]:
    """Registers such a model; the words that make ``wt-finetune`` use it."""
    uri = f"sqlite:///{tmp_path}/mlflow.db"

    def register(**changes: object) -> list[str]:
        with track.run("toy", "a run", uri=uri) as run:
            version = push("wt-toy", make_model(**changes), 0.5, run.id, uri=uri)
        return [f"model={version}", f"tracking.uri={uri}"]

    return register


def _graph(spec: TransitionSpec, shift: float) -> onnx.ModelProto:
    def port(name: str, width: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", width])

    graph = helper.make_graph(
        [helper.make_node("Add", ["o_next_sim", "shift"], ["o_next_real"])],
        "toy",
        [port("o", spec.n_obs), port("a", spec.n_action), port("o_next_sim", spec.n_obs)],
        [port("o_next_real", spec.n_obs)],
        [numpy_helper.from_array(np.float32(shift), "shift")],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
