"""What a finished ``wt fit`` leaves, checked against the data that it was made from."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import onnx
import onnxruntime
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from registry.card import Card
from tests.diagnose import synthetic
from tests.end_to_end.conftest import METHODS, STEPS, Place, Wt
from wt.config import load, to_yaml
from wt.data.transitions import digest
from wt.diagnose import pipeline
from wt.diagnose.observed.translation import TrainedTranslation
from wt.diagnose.result import Diagnosis
from wt.nets.world_model import WorldModel
from wt.train.selection import Unpaired
from wt.translate import translate_state
from wt.types import Transitions
from wt.worlds.base import make

if TYPE_CHECKING:
    from mlflow import MlflowClient

JOINTS = [f"joint{i}" for i in range(1, 7)]
R_USED = {"r5_force/real": "training"}
ALL_USED = {"r5_force/sim": "training", **R_USED}
USED = {
    "RawSim": {},
    "PairedCeiling": {"r5_force/real": "training, as pairs"},
    **dict.fromkeys(("DirectPred", "ResDyn", "ResDynSim", "RSSM"), R_USED),
}
"""Data of those that do not train on both domains, beside the test pairs."""
STATE = [f"{kind}/{joint}" for kind in ("qpos", "qvel") for joint in JOINTS]


@pytest.fixture(scope="module")
def results(finished: Path) -> dict[str, Any]:
    return json.loads((finished / "results.json").read_text())


@pytest.fixture(scope="module")
def client(place: Place, finished: Path) -> MlflowClient:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=place.store)


@pytest.fixture(scope="module")
def run_id(finished: Path) -> str:
    return (finished / "mlflow_run_id").read_text()


def table(data: Path, what: str) -> pa.Table:
    """A collection as it lies on disk."""
    (folder,) = data.glob(f"r5_force-{what}-*")
    return pa.concat_tables(pq.read_table(part) for part in sorted(folder.glob("part-*.parquet")))


def columns(of: pa.Table, prefix: str, names: Sequence[str]) -> np.ndarray:
    return np.stack([of[f"{prefix}/{name}"].to_numpy() for name in names], axis=1)


def test_the_folder_holds_what_was_promised(finished: Path, place: Place) -> None:
    for name in ("results.json", "results.md", "rollout.rrd", "model.onnx", "card.json"):
        assert (finished / name).stat().st_size > 0
    assert not [p for p in finished.rglob("*") if "tmp" in p.name or p.name.startswith(".")]
    assert to_yaml(load(finished / "config.yaml")) == to_yaml(
        load(place.words[1], [*place.words[2:], "workers=1"])
    )
    for figure in (finished / "figures").iterdir():
        assert figure.read_bytes().startswith(b"\x89PNG")
    assert len(list((finished / "figures").iterdir())) == 3
    for method in METHODS:
        assert f"| {method} |" in (finished / "results.md").read_text()


def test_results_follow_the_schema(results: dict[str, Any]) -> None:
    assert list(results)[:8] == [
        "schema", "task", "seeds", "single_step", "paper", "ratio_to_best_baseline", "model",
        "version",
    ]  # fmt: skip
    told = [results[key] for key in ("schema", "task", "seeds", "model", "version")]
    assert told == [1, "r5_force", [0], "wt-debug", 1]
    assert set(results["single_step"]) == set(METHODS)
    for score in results["single_step"].values():
        assert list(score) == ["mse", "std", "mse_change"]
        assert score["mse"] > 0 and score["std"] == 0.0 and score["mse_change"] > 0
    assert results["paper"]["WorldTranslation"] == 0.401467
    ours = results["single_step"]["WorldTranslationPlus"]["mse"]
    no_rivals = {"WorldTranslation", "WorldTranslationPlus", "SimulatorEncoder", "PairedCeiling"}
    baselines = [results["single_step"][m]["mse"] for m in METHODS if m not in no_rivals]
    assert results["ratio_to_best_baseline"] == pytest.approx(ours / min(baselines))


def test_errors_are_those_of_the_stored_pairs(results: dict[str, Any], place: Place) -> None:
    test, real = table(place.data, "test"), table(place.data, "real")
    truth, simulated = columns(test, "s_next", STATE), columns(test, "sim_next", STATE)
    now, after = columns(real, "o", STATE), columns(real, "s_next", STATE)
    error = (simulated - truth).astype(float)
    raw = results["single_step"]["RawSim"]
    assert raw["mse"] == pytest.approx(((error / after.std(0)) ** 2).mean(), rel=1e-4)
    assert raw["mse_change"] == pytest.approx(((error / (after - now).std(0)) ** 2).mean(), 1e-4)
    for channel, name in enumerate(STATE):
        told = results["per_channel"][name]
        assert told["unit"] == ("rad" if name.startswith("qpos") else "rad/s")
        assert told["rmse"]["RawSim"] == pytest.approx(np.sqrt((error[:, channel] ** 2).mean()))


def test_results_say_what_of_the_hidden_force_acts(results: dict[str, Any], place: Place) -> None:
    force = columns(table(place.data, "test"), "h", [f"force/{x}" for x in "xyz"])
    newtons = np.linalg.norm(force, axis=1)
    half = np.median(newtons[newtons > 0])
    assert f"half below {half:.0f} N" in results["note"]
    assert f"acts in {100 * (newtons > 0).mean():.0f} % of the test pairs" in results["note"]


def test_what_features_keep_is_told_of_the_test_pairs(
    results: dict[str, Any], finished: Path, place: Place, client: MlflowClient, run_id: str
) -> None:
    test, real = table(place.data, "test"), table(place.data, "real")
    observed = [*STATE, *(f"last_action/{joint}" for joint in JOINTS)]
    o, a = columns(test, "o", observed), columns(test, "a", [f"ctrl/{j}" for j in JOINTS])
    truth, std = columns(test, "s_next", STATE), columns(real, "s_next", STATE).std(0)
    config = load(finished / "config.yaml")
    model = WorldModel(make(config.world).spec, config.paper)
    weights = finished / "work/seed0/WorldTranslation/model.pt"
    model.load_state_dict(torch.load(weights, weights_only=True))
    frame, told = model.frame, results["extraction"]["WorldTranslation"]
    with torch.no_grad():
        x = frame.conditions(torch.tensor(o), torch.tensor(a))
        for name, outcome in (("own_outcome", "s_next"), ("untranslated", "sim_next")):
            s_next = torch.tensor(columns(test, outcome, STATE))
            z = model.encoder(x, frame.changes(torch.tensor(o), s_next))[0]
            error = frame.next_states(torch.tensor(o), model.decoder(x, z)).numpy() - truth
            assert told[name] == pytest.approx(((error / std) ** 2).mean(), rel=1e-3)
            if outcome == "s_next":
                assert told["active"] == (z.var(0) > 0.01).sum() and told["latents"] == 16
    logged = client.get_run(run_id).data.metrics
    assert logged["test/own_outcome/WorldTranslation"] == pytest.approx(told["own_outcome"])
    assert logged["test/active/WorldTranslation"] == told["active"]
    # ours translates nothing here, which its row says instead
    assert "WorldTranslationPlus" not in results["extraction"]
    assert "nothing is translated" in results["remarks"]["WorldTranslationPlus"]


def test_the_exported_graph_is_the_model_of_the_table(
    results: dict[str, Any], finished: Path, place: Place
) -> None:
    test, real = table(place.data, "test"), table(place.data, "real")
    observed = [*STATE, *(f"last_action/{joint}" for joint in JOINTS)]
    o, a = columns(test, "o", observed), columns(test, "a", [f"ctrl/{j}" for j in JOINTS])
    sim_next, truth = columns(test, "sim_next", STATE), columns(test, "s_next", STATE)
    graph = onnxruntime.InferenceSession(
        (finished / "model.onnx").read_bytes(), providers=["CPUExecutionProvider"]
    )
    inputs = {"o": o, "a": a, "o_next_sim": np.hstack([sim_next, a])}
    (answer,) = graph.run(["o_next_real"], inputs)
    error = (answer[:, :12] - truth) / columns(real, "s_next", STATE).std(0)
    ours = results["single_step"]["WorldTranslationPlus"]["mse"]
    assert (error.astype(float) ** 2).mean() == pytest.approx(ours, rel=1e-4)
    np.testing.assert_array_equal(answer[:, 12:], a)

    config = load(finished / "config.yaml")
    model = WorldModel(make(config.world).spec, config.plus)
    weights = finished / "work" / "seed0" / "WorldTranslationPlus" / "model.pt"
    model.load_state_dict(torch.load(weights, weights_only=True))
    with torch.no_grad():
        eager = translate_state(model.eval(), *(torch.tensor(x) for x in (o, a, sim_next)))
    np.testing.assert_allclose(answer[:, :12], eager.numpy(), atol=1e-5, rtol=1e-5)


def test_the_card_tells_the_same(results: dict[str, Any], finished: Path, place: Place) -> None:
    card = Card.load(finished)
    assert (card.name, card.task, card.rate_hz) == ("wt-debug", "r5_force", 50.0)
    assert list(card.joints) == JOINTS
    # what selects are the last tenths of both domains, three of thirty episodes each
    observed = [*STATE, *(f"last_action/{joint}" for joint in JOINTS)]
    held = {}
    for domain in ("sim", "real"):
        rows = table(place.data, domain)[-150:]
        oa = columns(rows, "o", observed), columns(rows, "a", [f"ctrl/{j}" for j in JOINTS])
        held[domain] = (*oa, columns(rows, "s_next", STATE))
    o, a, s_next = held["sim"]
    session = onnxruntime.InferenceSession(finished / "model.onnx")
    inputs = {"o": o, "a": a, "o_next_sim": np.hstack([s_next, a])}
    held["sim"] = (o, a, session.run(["o_next_real"], inputs)[0][:, :12])
    sim, real = (
        Transitions(
            o=o, a=a, s_next=s_next, nominal=s_next, hidden=np.zeros((150, 0), np.float32),
            episode=np.arange(150) // 50, step=np.arange(150) % 50,
        )
        for o, a, s_next in held.values()
    )  # fmt: skip
    distance = Unpaired(sim, real).error(torch.tensor(sim.s_next))
    assert (card.heldout.set, card.heldout.metric) == ("held-out transitions", "energy_distance")
    assert card.heldout.value == pytest.approx(distance, rel=1e-3)
    assert results["model_selection"] == "unpaired"
    assert not list(place.data.glob("*-validation-*"))  # no pairs but those that judge
    assert [port.name for port in card.outputs] == ["o_next_real", "z", "z_translated"]
    assert card.joints == tuple(JOINTS) and card.opset == 18
    assert card.parity is not None and card.parity <= 1e-5
    for method in METHODS:
        assert card.metrics[f"{method}/mse"] == results["single_step"][method]["mse"]


def test_graph_and_card_agree_in_all_that_the_graph_says(finished: Path) -> None:
    graph = onnx.load(finished / "model.onnx")
    said = {entry.key: entry.value for entry in graph.metadata_props}
    card = json.loads((finished / "card.json").read_text())
    ports = {port["name"]: port["channels"] for port in (*card["inputs"], *card["outputs"])}
    on_card = {
        "joint_names": ",".join(card["joints"]),
        "rate_hz": f"{card['rate_hz']:g}",
        **{
            f"{name}_{key}s": ",".join(channel[key] for channel in ports[name])
            for name in ("o", "a", "o_next_sim", "o_next_real")
            for key in ("name", "unit")
        },
    }
    for key in ("task", "normalizer", "features", "data_hash", "commit"):
        on_card[key] = card[key]
    assert said == on_card  # none is missing on either side
    # without pairs Algorithm 1 has no part in ours
    assert said["features"].startswith("untrained")


def test_the_recording_is_whole(finished: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(finished / "rollout.rrd")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "verified without error" in done.stdout + done.stderr


def test_mlflow_holds_the_whole_run(
    results: dict[str, Any], client: MlflowClient, run_id: str, finished: Path
) -> None:
    held = client.get_run(run_id)
    assert held.info.status == "FINISHED"
    assert held.info.run_name == "finished"
    assert held.data.params["plus.train.steps"] == str(STEPS)
    assert held.data.params["world.force.max_newton"] == "200.0"
    for method in METHODS:
        assert held.data.metrics[f"test/mse/{method}"] == results["single_step"][method]["mse"]
    below = client.search_runs([held.info.experiment_id], f"tags.`mlflow.parentRunId` = '{run_id}'")
    children = {run.info.run_name: run for run in below}
    assert set(children) == {f"{method}, seed 0" for method in METHODS}
    for method in METHODS:
        told = children[f"{method}, seed 0"].data.metrics["test/mse"]
        assert told == results["single_step"][method]["mse"]
    for method in METHODS:
        one = children[f"{method}, seed 0"]
        words = one.data.tags["mlflow.note.content"]
        assert words.startswith(f"`{method}` on the task `r5_force`, seed 0: ") and len(words) > 150
        assert {
            d.dataset.name: {tag.key: tag.value for tag in d.tags}["mlflow.data.context"]
            for d in one.inputs.dataset_inputs
        } == {"r5_force/test": "test", **USED.get(method, ALL_USED)}
        assert "names" not in one.data.params  # of all baselines
        assert one.data.tags["paper.row"] == "figure 3, r5_force"
        assert one.info.end_time < held.info.end_time
        if method == "RawSim":  # which learns nothing
            continue
        assert "system/cpu_utilization_percentage" in one.data.metrics
        curves = [name for name in one.data.metrics if name.startswith("val/")]
        # without pairs ours has no loop, but regressions
        assert set(curves) & {"val/energy_distance", "val/mse", "val/shift"}, (method, curves)
        history = client.get_metric_history(one.info.run_id, curves[0])
        assert len({m.step for m in history}) > 4, method
    child = children["WorldTranslation, seed 0"]
    assert child.data.params["method"] == "WorldTranslation"
    assert child.data.params["train.steps"] == str(STEPS)
    for inner in (
        "gan/accuracy", "gan/cycle", "latent/active_std", "vae/domain_accuracy", "gradient/vae",
        "gradient/judges", "val/energy_distance",
    ):  # fmt: skip
        history = client.get_metric_history(child.info.run_id, inner)
        assert max(m.step for m in history) == STEPS
        assert np.isfinite([m.value for m in history]).all()
    folder = Path(held.info.artifact_uri)
    for name in ("config.yaml", "results.json", "rollout.rrd", "figures/single_step.png"):
        assert (folder / name).read_bytes() == (finished / name).read_bytes()
    shown = json.loads((folder / "single_step.json").read_text())
    assert shown["columns"] == ["method", "mse", "std", "mse_change"]
    assert {row[0]: row[1] for row in shown["data"]} == {
        method: score["mse"] for method, score in results["single_step"].items()
    }
    used = {d.dataset.name: d.dataset.digest for d in held.inputs.dataset_inputs}
    assert set(used) == {f"r5_force/{what}" for what in ("sim", "real", "test")}
    both = [used["r5_force/sim"], used["r5_force/real"]]
    assert digest(both) == Card.load(finished).data_hash
    assert (held.data.tags["task"], held.data.tags["paper.row"]) == (
        "r5_force", "figure 3, r5_force"
    )  # fmt: skip
    assert len(held.data.tags["commit"]) == 40 or held.data.tags["commit"] == "unknown"


def test_the_model_is_registered_as_champion(
    client: MlflowClient, run_id: str, finished: Path, wt: Wt, tmp_path: Path
) -> None:
    champion = client.get_model_version_by_alias("wt-debug", "champion")
    made_by = client.get_run(champion.run_id)
    assert (int(champion.version), made_by.info.run_name) == (1, "WorldTranslationPlus, seed 0")
    assert made_by.data.tags["mlflow.parentRunId"] == run_id
    (output,) = made_by.outputs.model_outputs
    model = client.get_logged_model(output.model_id)
    assert champion.source == f"models:/{model.model_id}"
    assert "Features (`z`, `z_translated`): untrained" in champion.description
    assert (model.source_run_id, model.params) == (champion.run_id, made_by.data.params)
    card = Card.load(finished)
    assert made_by.data.metrics["heldout/energy_distance"] == card.heldout.value
    assert made_by.data.metrics["test/mse"] == card.metrics["WorldTranslationPlus/mse"]
    assert "`WorldTranslationPlus, seed 0`" in client.get_run(run_id).data.tags["model"]
    code, _, err = wt("registry", "pull", "wt-debug@champion", "--to", tmp_path / "pulled")
    assert (code, err) == (0, "")
    for name in ("model.onnx", "card.json"):
        assert (tmp_path / "pulled" / name).read_bytes() == (finished / name).read_bytes()


def test_a_finished_run_that_is_resumed_registers_nothing_new(
    client: MlflowClient, run_id: str, finished: Path, wt: Wt
) -> None:
    names = ("results.json", "model.onnx", "card.json")
    before = {name: (finished / name).read_bytes() for name in names}
    (finished / "results.json").unlink()  # as a kill right after the registration leaves it
    code, out, err = wt("fit", "--config", finished / "config.yaml", "--resume", "--out", finished)
    assert (code, [x for x in err.splitlines() if " % after " not in x]) == (0, [])
    assert "wt-debug/1: champion: the first one" in out
    assert {name: (finished / name).read_bytes() for name in names} == before
    versions = client.search_model_versions("name='wt-debug'")
    of_run = {v.run_id: client.get_run(v.run_id).data.tags["mlflow.parentRunId"] for v in versions}
    assert [int(v.version) for v in versions if of_run[v.run_id] == run_id] == [1]


def test_a_diagnosis_reads_the_registered_model(
    wt: Wt, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its answer to the golden rows, and features that differ where o′ is R's or S's."""
    asked: list[TrainedTranslation] = []

    def stand_in(*_: object, translation: TrainedTranslation, **__: object) -> Diagnosis:
        asked.append(translation)
        return synthetic.diagnosis(str(model))

    model = synthetic.write_model(tmp_path)
    monkeypatch.setattr(pipeline, "diagnose", stand_in)
    words = ("diagnose", model, "a.parquet", "--out", tmp_path / "out", "--translation")
    code, _, err = wt(*words, "wt-debug@champion")
    assert code == 0, err
    (translation,) = asked
    card = json.loads((finished / "card.json").read_text())
    assert [c.name for c in translation.action] == [
        c["name"] for c in card["inputs"][1]["channels"]
    ]
    golden = {name: np.array(rows, np.float32) for name, rows in card["golden"].items()}
    answer, z, expected = translation.run(golden["o"], golden["a"], golden["o_next_sim"])
    np.testing.assert_allclose(answer, golden["o_next_real"], atol=1e-4)
    assert z.shape == expected.shape and np.abs(z - expected).max() > 1e-3
    code, _, err = wt(*words, "wt-nobody@champion")
    assert code == 2 and "wt-nobody" in err and err.count("\n") == 1
