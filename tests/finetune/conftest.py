"""Models of the Go2's task whose answer is known: R is S, moved by a constant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from registry.push import push
from tests.toy_models import shifted
from wt.finetune.config import Finetune, load
from wt.finetune.setting import Setting
from wt.run import track

MakeModel = Callable[..., Path]

TINY = [
    "task=conf/go2_payload_20min.yaml", "variants=[none,randomization,translation]",
    "diagnosed.mjcf=null", "diagnosed.model=null", "workers=1",
    "training.robots=4", "training.threads=1", "training.ppo.iterations=2", "training.ppo.steps=4",
    "seeds=[0]", "training.ppo.warm_up=1", "share=0.75", "evaluation.episodes=2",
    "evaluation.commands=[[0.2,0,0,0.5]]",
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
        return shifted(folder, spec, shift)

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
