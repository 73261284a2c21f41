from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from wt.cli.main import main
from wt.config import load
from wt.errors import ConfigError
from wt.evaluate import paper
from wt.evaluate.results import Extraction, MethodScore, Results
from wt.reproduce.exhibits.figure_3 import SingleStep, figure, head, rows
from wt.reproduce.tasks import QUICK, TASKS, chosen
from wt.types import Channel

CONF = Path(__file__).resolve().parents[2] / "conf"
PAYLOAD = next(task for task in TASKS if task.name == "go2_payload")


def results(task: str, ours: float = 0.1) -> Results:
    scores = {
        "RawSim": MethodScore(0.4, 0.0, 1.0),
        "DirectPred": MethodScore(0.2, 0.02, 1.0),
        "WorldTranslation": MethodScore(0.3, 0.04, 1.0),
        "WorldTranslationPlus": MethodScore(ours, 0.01, 1.0),
    }
    return Results(task, (0, 1, 2), scores)


def test_tasks_are_the_papers() -> None:
    assert {task.name for task in TASKS} == set(paper.SINGLE_STEP)


@pytest.mark.parametrize("task", chosen([], CONF)[0], ids=lambda task: task.name)
def test_configurations_make_the_tasks_they_are_named_after(task: object) -> None:
    assert load(CONF / task.config, QUICK).task == task.name  # type: ignore[attr-defined]


def test_tasks_without_a_configuration_are_said(tmp_path: Path) -> None:
    (tmp_path / "r5.yaml").write_text("")
    there, missing = chosen([], tmp_path)
    assert [task.name for task in there] == ["r5_force"]
    assert len(missing) == len(TASKS) - 1
    with pytest.raises(ConfigError, match=r"holds none of go2_payload\.yaml"):
        chosen(["go2_payload"], tmp_path)


def test_a_wrong_name_is_refused() -> None:
    with pytest.raises(ConfigError, match="go2_payload"):
        chosen(["go2_paylod"], CONF)


def test_table_has_ours_beside_the_papers() -> None:
    found = {PAYLOAD: results("go2_payload")}
    assert head(found) == ["method / RawSim", "Go2 payload", "paper's"]
    table = {row[0]: row[1:] for row in rows(found)}
    assert table["RawSim"] == ["1", "1"]
    # 0.3 / 0.4, 0.04 / 0.4; and figure 3: 0.147927 / 0.305472
    assert table["WorldTranslation"] == ["0.75 ± 0.1", "0.484"]
    assert table["WorldTranslationPlus"][1] == "–"
    # 0.1 / 0.2; and 0.147927 / 0.298, its best baseline RSSM
    assert table["WorldTranslationPlus / best baseline"] == ["0.5", "0.496"]


def test_figure_has_a_panel_a_robot_and_a_bar_a_method() -> None:
    both = {task: results(task.name) for task in TASKS if task.robot != "G1 humanoid"}
    panels = figure(both).axes
    assert [axes.get_title(loc="left") for axes in panels] == ["Go2 quadruped", "R5 manipulator"]
    heights = sorted({round(float(bar.get_height()), 6) for bar in panels[0].patches
                      if bar.get_height() == bar.get_height()})  # fmt: skip
    assert heights == [0.25, 0.5, 0.75, 1.0]


def test_figures_of_other_units_are_their_errors_over_rawsim_s() -> None:
    channels = (Channel("qpos/a", "rad"), Channel("qvel/a", "rad/s"))
    of = replace(
        results("go2_payload"),
        channels=channels,
        rmse={"RawSim": (0.0, 2.0), "DirectPred": (1.0, 1.0)},
    )
    assert of.physical_mse("RawSim") == 2.0 and of.physical_mse("DirectPred") == 1.0
    (axes,) = figure({PAYLOAD: of}, "physical", Results.physical_mse).axes
    heights = [float(bar.get_height()) for bar in axes.patches]
    assert [height for height in heights if height == height] == [1.0, 0.5]
    assert "physical" in axes.get_ylabel()
    said, table = of.physical()
    assert said[-1] == "all, squared" and {row[0]: row[-1] for row in table}["RawSim"] == "2"


def test_the_report_marks_rows_says_why_and_what_selected() -> None:
    why = "extraction gains nothing: encoding and decoding R's own outcome makes 0.3."
    marked = replace(
        results("go2_payload"),
        remarks={"WorldTranslation": why},
        extraction={"WorldTranslation": Extraction(16, 2.0, 0.3, 0.35)},
        model_selection="unpaired",
    )
    section = SingleStep().present({"go2_payload": marked.to_json()})
    cells = {row[0]: row[1] for row in section.grids[0].rows}
    assert cells["WorldTranslation"] == "0.75 ± 0.1*" and "*" not in cells["DirectPred"]
    assert f"* WorldTranslation: {why} (Go2 quadruped, payload)" in section.differences
    assert any("model_selection: unpaired" in line for line in section.differences)
    assert ["WorldTranslation", "2 of 16", "0.3", "0.2", "0.35", "0.3"] in [
        list(row) for grid in section.grids for row in grid.rows
    ]
    assert {"single_step", "single_step_change", "single_step_physical"} == set(section.figures)


def test_finished_runs_are_reused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "out" / "go2_payload"
    run.mkdir(parents=True)
    from wt.config import to_yaml

    (run / "config.yaml").write_text(to_yaml(load(CONF / "go2_payload.yaml", ["seeds=[0,1,2]"])))
    results("go2_payload").save(run)
    words = ["reproduce", "--only", "figure-3", "--task", "go2_payload", "--conf", str(CONF)]
    words += ["--out", str(run.parent)]
    assert main([*words, "seeds=[0,1,2]"]) == 0
    assert "0.75 ± 0.1" in capsys.readouterr().out
    text = (run.parent / "report.md").read_text()
    assert "| WorldTranslation | 0.75 ± 0.1 | 0.484 |" in text
    assert "![Single-step prediction" in text
    assert (run.parent / "single_step.png").read_bytes().startswith(b"\x89PNG")
    # another configuration is another run
    assert main([*words, "seeds=[0,1]"]) == 2
    assert "configuration differs" in capsys.readouterr().err
