"""``results.json`` against the public schema, the ratio against hand arithmetic."""

import io
import json
import math
import re
import statistics
from pathlib import Path

import pytest
from rich.console import Console

from tests.conftest import FromShared
from wt.config import ModelSelection
from wt.errors import DataError
from wt.evaluate import paper
from wt.evaluate.results import ENCODER, Extraction, MethodScore, Results
from wt.types import Channel


def results(**changed: object) -> Results:
    """Results of three methods, all known to the paper but ours."""
    values: dict[str, object] = {
        "task": "r5_force",
        "seeds": (0, 1, 2),
        "single_step": {
            "WorldTranslation": MethodScore(0.1, 0.01, 0.2),
            "WorldTranslationPlus": MethodScore(0.15, 0.02, 0.3),
            "RSSM": MethodScore(0.6, 0.03, 0.7),
            "ResDynSim": MethodScore(0.5, 0.0, 0.8),
        },
        "model": "wt-r5",
        "version": 4,
        "channels": (Channel("qpos/joint1", "rad"), Channel("qvel/joint1", "rad/s")),
        "rmse": {"WorldTranslationPlus": (0.01, 0.1), "RSSM": (0.02, 0.2)},
    }
    return Results(**{**values, **changed})  # type: ignore[arg-type]


def test_json_follows_the_public_schema(tmp_path: Path) -> None:
    results().save(tmp_path)
    content = json.loads((tmp_path / "results.json").read_text())
    assert list(content)[:8] == [
        "schema", "task", "seeds", "single_step", "paper", "ratio_to_best_baseline", "model",
        "version",
    ]  # fmt: skip
    assert content["schema"] == 1
    assert content["seeds"] == [0, 1, 2]
    assert content["single_step"]["RSSM"] == {"mse": 0.6, "std": 0.03, "mse_change": 0.7}
    assert content["paper"]["WorldTranslation"] == 0.401467
    # ours over the best baseline; the paper's own method, though better, is no baseline
    assert content["ratio_to_best_baseline"] == pytest.approx(0.3)
    assert (content["model"], content["version"]) == ("wt-r5", 4)
    assert content["per_channel"]["qvel/joint1"] == {
        "unit": "rad/s",
        "rmse": {"WorldTranslationPlus": 0.1, "RSSM": 0.2},
    }
    assert "given the true hidden variable" in content["note"]


def test_physical_errors_are_by_kind_of_channel(tmp_path: Path) -> None:
    channels = tuple(Channel(n, u) for n, u in (("qpos/a", "rad"), ("qpos/b", "rad"),
                                                ("gyro/x", "rad/s")))  # fmt: skip
    three = results(
        channels=channels, rmse={"RSSM": (3.0, 4.0, 0.5), "WorldTranslation": (1.0, 1.0, 1.0)}
    )
    assert three.groups[Channel("qpos", "rad")]["RSSM"] == pytest.approx(math.sqrt(12.5))
    three.save(tmp_path)
    said = json.loads((tmp_path / "results.json").read_text())["per_group"]
    assert said["gyro"] == {"unit": "rad/s", "rmse": {"RSSM": 0.5, "WorldTranslation": 1.0}}
    text = three.to_markdown()
    assert "| method | qpos [rad] | gyro [rad/s] |" in text and "| RSSM | 3.54 | 0.5 |" in text
    console = Console(width=80, file=io.StringIO(), record=True)
    three.print_table(console)
    assert "gyro [rad/s]" in console.export_text()


def test_a_row_with_a_remark_is_marked_and_explained(tmp_path: Path) -> None:
    marked = results(remarks={"WorldTranslation": "extraction gains nothing."})
    text = marked.to_markdown()
    assert "| WorldTranslation* |" in text and "| RSSM |" in text
    assert "* WorldTranslation: extraction gains nothing." in text
    console = Console(width=80, file=io.StringIO(), record=True)
    marked.print_table(console)
    assert "WorldTranslation*" in (shown := console.export_text()) and "gains nothing" in shown
    marked.save(tmp_path)
    assert Results.load(tmp_path) == marked


def test_what_features_keep_stands_beside_directpred(tmp_path: Path) -> None:
    scores = {**results().single_step, "DirectPred": MethodScore(0.4, 0.0, 0.5)}
    kept = {"WorldTranslation": Extraction(16, 5.5, 0.08, 0.2)}
    three = results(single_step=scores, extraction=kept)
    assert "| WorldTranslation | 5.5 of 16 | 0.08 | 0.4 | 0.2 | 0.1 |" in three.to_markdown()
    console = Console(width=100, file=io.StringIO(), record=True)
    three.print_table(console)
    assert "5.5 of 16" in console.export_text()
    three.save(tmp_path)
    assert Results.load(tmp_path) == three
    assert "active z" not in results().to_markdown()


@pytest.mark.parametrize("selection", ["unpaired", "pairs"])
def test_every_table_says_what_selected(selection: ModelSelection, tmp_path: Path) -> None:
    selected = results(model_selection=selection)
    selected.save(tmp_path)
    assert f"model_selection: {selection}" in (tmp_path / "results.md").read_text()
    assert json.loads((tmp_path / "results.json").read_text())["model_selection"] == selection
    console = Console(width=200, file=io.StringIO(), record=True)
    selected.print_table(console)
    assert f"model_selection: {selection}" in console.export_text()


def test_what_is_saved_is_what_is_loaded(tmp_path: Path) -> None:
    for saved in (results(), results(task="so101", model=None, version=None, rmse={}, channels=())):
        saved.save(tmp_path)
        assert Results.load(tmp_path) == saved


def test_a_diverged_method_stays_in_the_table_and_out_of_the_ratio(tmp_path: Path) -> None:
    nan = math.nan
    scores = {**results().single_step, "RawSim": MethodScore(nan, nan, nan)}
    diverged = results(single_step=scores)
    assert diverged.ratio_to_best_baseline == pytest.approx(0.3)
    diverged.save(tmp_path)
    assert "NaN" not in (tmp_path / "results.json").read_text()
    assert math.isnan(Results.load(tmp_path).single_step["RawSim"].mse)
    assert "| RawSim | diverged |" in (tmp_path / "results.md").read_text()


def test_the_simulator_as_encoder_is_ours_and_no_rival() -> None:
    beside = results(single_step={**results().single_step, ENCODER: MethodScore(1e-9, 0.0, 1e-9)})
    assert beside.ratio_to_best_baseline == results().ratio_to_best_baseline


def test_what_is_possible_is_no_rival() -> None:
    ceiling = {**results().single_step, "PairedCeiling": MethodScore(1e-9, 0.0, 1e-9)}
    beside = results(single_step=ceiling)
    assert beside.ratio_to_best_baseline == results().ratio_to_best_baseline
    rows = [line for line in beside.to_markdown().splitlines() if line.startswith("| ")]
    methods = rows[2 : 2 + len(ceiling)]  # below the head
    assert methods[-1].startswith("| PairedCeiling | 1e-09 |")
    assert methods[1].startswith("| WorldTranslation | **0.1** |")


def test_no_ratio_without_baselines_or_without_ours() -> None:
    ours = {"WorldTranslationPlus": MethodScore(0.1, 0.0, 0.1)}
    assert results(single_step=ours).to_json()["ratio_to_best_baseline"] is None
    baseline = {"RawSim": MethodScore(0.1, 0.0, 0.1)}
    assert results(single_step=baseline).to_json()["ratio_to_best_baseline"] is None


def test_spread_is_the_sample_standard_deviation() -> None:
    score = MethodScore.of_seeds([1.0, 2.0, 4.0], [3.0, 3.0, 6.0])
    assert (score.mse, score.mse_change) == (pytest.approx(7 / 3), 4.0)
    assert score.std == pytest.approx(statistics.stdev([1.0, 2.0, 4.0]))
    assert MethodScore.of_seeds([1.0], [2.0]) == MethodScore(1.0, 0.0, 2.0)


def test_markdown_puts_the_papers_numbers_beside_ours_and_states_the_assumption() -> None:
    text = results().to_markdown()
    # the paper's RSSM makes 0.515493 / 0.706230 = 0.73 of its RawSim's error; ours has no RawSim
    assert "| RSSM | 0.6 | 0.03 | 0.7 | – | 0.515 | 0.73 |" in text
    assert "| WorldTranslationPlus | 0.15 |" in text
    assert "| WorldTranslation | **0.1** |" in text
    assert text.index("| WorldTranslationPlus |") < text.index("| WorldTranslation |")
    assert "given the true hidden variable" in text[text.index("| RSSM |") :]
    assert "| qvel/joint1 [rad/s] | 0.1 | 0.2 |" in text
    assert "paper's" not in results(task="so101", note="").to_markdown()


def test_errors_relative_to_rawsim_are_what_worlds_share() -> None:
    with_raw = {"RawSim": MethodScore(0.5, 0.0, 0.5), "RSSM": MethodScore(0.25, 0.0, 0.5)}
    assert results(single_step=with_raw, rmse={}).relative("RSSM") == 0.5
    assert math.isnan(results().relative("RSSM"))


def test_terminal_table_names_every_method_and_the_ratio() -> None:
    console = Console(width=80, file=io.StringIO(), record=True)
    results().print_table(console)
    text = console.export_text()
    assert "…" not in text
    for word in ("WorldTranslationPlus", "ResDynSim", "0.6", "0.515", "0.300", "hidden"):
        assert word in text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "does not exist; give the folder"),
        ('{"schema": 1, "task"', "is not a results file"),
        ('{"schema": 2}', "schema 2"),
        ('{"schema": 1}', "is not a results file"),
        ("[]", "is not a results file"),
    ],
)
def test_unreadable_results_are_one_clear_line(
    tmp_path: Path, content: str | None, message: str
) -> None:
    if content is not None:
        (tmp_path / "results.json").write_text(content)
    with pytest.raises(DataError, match=message) as error:
        Results.load(tmp_path)
    assert "\n" not in str(error.value)


def test_errors_of_another_number_of_channels_are_refused() -> None:
    with pytest.raises(DataError, match="'RSSM' has errors of 1 channels, 2 are needed"):
        results(rmse={"RSSM": (0.1,)})


def test_the_papers_numbers_are_those_of_its_figure(from_shared: FromShared) -> None:
    source = from_shared("paper.tex")
    pattern = r"coordinates \{\((\w+), ([\d.]+)\) \((\w+), ([\d.]+)\)\}"
    found = re.findall(pattern, source.read_text())
    methods = ("RawSim", "DirectPred", "RSSM", "ResDyn", "WorldTranslation")
    for i, robot in enumerate(("g1", "go2", "r5")):
        for method, row in zip(methods, found[5 * i : 5 * i + 5], strict=True):
            for condition, number in (row[:2], row[2:]):
                task = f"{robot}_{condition.lower()}"
                assert paper.SINGLE_STEP[task][method] == float(number), (task, method)
