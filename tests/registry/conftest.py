"""A model whose answer is known in closed form, and MLflow stores to keep it in."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from registry.card import HeldOut
from tests.toy_models import save
from wt.types import Channel, TransitionSpec

MakeFolder = Callable[..., Path]
WEIGHT = np.array([[0.5, -1.0, 0.25], [2.0, 0.0, -0.125]], dtype=np.float32)

SPEC = TransitionSpec(
    task="toy",
    rate_hz=50.0,
    joints=("hip", "knee"),
    observation=(Channel("qpos/hip", "rad"), Channel("qpos/knee", "rad"), Channel("v", "rad/s")),
    n_state=3,
    action=(Channel("u1", "rad"), Channel("u2", "rad")),
)

NODES = (
    helper.make_node("MatMul", ["a", "w"], ["x"]),
    helper.make_node("Mul", ["o", "tenth"], ["y"]),
    helper.make_node("Add", ["x", "y"], ["z"]),
    helper.make_node("Add", ["z", "o_next_sim"], ["o_next_real"]),
)


@pytest.fixture(scope="session", autouse=True)
def quiet() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_DISABLE_TELEMETRY", "true")
        patch.setenv("ORT_DISABLE_TELEMETRY", "1")
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        yield


@pytest.fixture(scope="session")
def spec() -> TransitionSpec:
    return SPEC


@pytest.fixture(scope="session")
def truth() -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """o' of R = o' of S + o / 10 + a W, which the graph above computes too."""
    return lambda o, a, o_next_sim: (o_next_sim + 0.1 * o + a @ WEIGHT).astype(np.float32)


@pytest.fixture(scope="session")
def rows() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return tuple(rng.normal(size=(5, n)).astype(np.float32) for n in (3, 2, 3))


@pytest.fixture
def make_folder(
    tmp_path: Path,
    truth: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> MakeFolder:
    """Makes folders with ``model.onnx`` and ``card.json``, ready to push."""

    def make(value: float = 0.5, data_hash: str = "heldout-1", parity: float | None = 1e-7) -> Path:
        folder = tmp_path / f"model-{len(list(tmp_path.glob('model-*')))}"
        return save(
            folder, SPEC, NODES, {"w": WEIGHT, "tenth": np.array(np.float32(0.1))},
            (*rows, truth(*rows)), metrics={"mse_change": 0.25},
            heldout=HeldOut("pairs/test", data_hash, "mse", value), parity=parity,
        )  # fmt: skip

    return make


@pytest.fixture(scope="session")
def _empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sqlite store made once: filling a new one with tables takes seconds."""
    from registry.backend import connect

    path = tmp_path_factory.mktemp("empty") / "mlflow.db"
    connect(f"sqlite:///{path}", create=True)
    return path


@pytest.fixture
def store_uri(tmp_path: Path, _empty_store: Path) -> str:
    (tmp_path / "store").mkdir()
    shutil.copy(_empty_store, tmp_path / "store" / "mlflow.db")
    return f"sqlite:///{tmp_path}/store/mlflow.db"


@pytest.fixture
def run_id(store_uri: str) -> str:
    from wt.run import track

    with track.run("toy", "a run", uri=store_uri) as run:
        return run.id
