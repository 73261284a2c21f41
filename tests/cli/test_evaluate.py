"""``wt evaluate`` on a model registered for the purpose: the simulator's answer, plus a bit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from registry.push import push
from tests.toy_models import shifted
from wt import registered
from wt.cli.main import main
from wt.config import load
from wt.run import track
from wt.worlds.base import make

CONF = Path(__file__).resolve().parents[2] / "conf"
OFF = 0.01
WORLDS = {
    "r5.yaml": "{arms: 8, episode_steps: 50, motion: {routes: 2, route_seconds: 5}, threads: 1}",
    "go2_payload.yaml": "{robots: 4, episode_steps: 50, threads: 1}",
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with small configurations and a store with a model of a walking robot."""
    home = tmp_path_factory.mktemp("evaluate")
    uri = f"sqlite:///{home}/mlflow.db"
    for file, world in WORLDS.items():
        (home / file).write_text(
            f"base: {CONF / file}\nworld: {world}\ntracking: {{uri: '{uri}'}}\n"
            f"data: {{dir: {home / 'data'}, transitions: 300, validation_pairs: 50, "
            "test_pairs: 200}\n"
        )
    config = load(home / "go2_payload.yaml")
    spec = make(config.world).spec
    folder = shifted(home / "model", spec, OFF, config.registry_name)
    with track.run("test", spec.task, uri=uri) as run:
        push(config.registry_name, folder, 0.5, run.id, uri=uri)
    return home


@pytest.fixture(autouse=True)
def no_store_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


def test_errors_are_the_graphs_on_the_tasks_pairs(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registered, "ROLLOUTS", 3)
    monkeypatch.setattr(registered, "HORIZON", 4)
    out = place / "out"
    words = ["evaluate", "wt-go2-payload@champion", "--config", str(place / "go2_payload.yaml")]
    assert main([*words, "--out", str(out)]) == 0
    assert "WorldTranslationPlus" in capsys.readouterr().out
    found = json.loads((out / "results.json").read_text())
    assert (found["task"], found["model"]) == ("go2_payload", "wt-go2-payload")
    rmse = [row["rmse"] for row in found["per_channel"].values()]
    # (x + off)² = x² + 2 x off + off²: the two differ by off at most
    assert all(abs(r["WorldTranslationPlus"] - r["RawSim"]) <= OFF + 1e-6 for r in rmse)
    assert any(r["WorldTranslationPlus"] != r["RawSim"] for r in rmse)
    pictures = ["multi_step.png", "per_channel.png", "single_step.png"]
    assert sorted(p.name for p in out.glob("*.png")) == pictures


@pytest.mark.parametrize(
    ("reference", "file", "said"),
    [
        ("wt-go2-payload@champion", "r5.yaml", "its task is 'go2_payload'"),
        ("wt-go3-payload@champion", "r5.yaml", "did you mean 'wt-go2-payload'"),
        ("wt-go2-payload", "r5.yaml", "names no model version"),
    ],
)
def test_a_model_that_does_not_fit_is_one_clear_line(
    place: Path, capsys: pytest.CaptureFixture[str], reference: str, file: str, said: str
) -> None:
    words = ["evaluate", reference, "--config", str(place / file), "--out", str(place / "none")]
    assert main(words) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not (place / "none").exists()
