"""The demonstration keeps to its folder and does not do again what is done."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from wt import demo
from wt.errors import UserError, WorkError


def test_a_folder_with_something_else_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(UserError, match="holds something else"):
        demo.prepare(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(UserError, match="is a file"):
        demo.prepare(tmp_path / "thesis.tex")


def test_the_examples_are_copied_and_an_earlier_demonstration_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    for _ in range(2):
        demo.prepare(folder)
    for name in ("arm", "cart", "go2"):
        assert (folder / "examples" / name / "model.xml").is_file()


def test_every_step_is_a_command_in_the_folder_and_done_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, ran, said = tmp_path / "demo", list[str](), list[str]()
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://elsewhere")

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        environment = options["env"]
        assert isinstance(environment, dict) and "MLFLOW_TRACKING_URI" not in environment
        assert options["cwd"] == folder
        ran.append(" ".join(command[3:]))
        return subprocess.CompletedProcess(command, 0, "done", "")

    monkeypatch.setattr(subprocess, "run", run)
    demo.prepare(folder)
    for lane in demo.lanes(folder):
        for step in lane:
            demo._run(folder, step, said.append)
            product = folder / step.product
            product.parent.mkdir(exist_ok=True)
            product.touch()
            demo._run(folder, step, said.append)
    assert [words.split()[0] for words in ran] == ["diagnose", "diagnose", "fit"]
    assert said[0].startswith("\n$ wt diagnose examples/arm/model.xml examples/arm/1.parquet")


def test_a_step_that_fails_says_why_in_one_line(tmp_path: Path) -> None:
    step = demo.Step(("wt", "diagnose", "none.xml", "none.parquet", "--out", "x"), "x")
    with pytest.raises(WorkError, match=r"failed: .*none"):
        demo._run(tmp_path, step, print)


def test_a_fit_that_was_interrupted_is_continued(tmp_path: Path) -> None:
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "config.yaml").touch()
    (fit,) = demo.lanes(tmp_path)[1]
    assert "--resume" in fit.words and "fit/config.yaml" in fit.words


def test_what_was_said_stands_beside_what_was_hidden(tmp_path: Path) -> None:
    demo.prepare(tmp_path / "demo")
    gap = {"value": 0.0411, "unit": "rad", "ci95": [0.0397, 0.0425]}
    said = {"statement": "Joint shoulder has play.", "parameters": {"gap": gap}}
    for name, findings in (("arm", [said]), ("cart", [])):
        (tmp_path / "demo" / name).mkdir()
        found = json.dumps({"findings": findings})
        (tmp_path / "demo" / name / "diagnosis.json").write_text(found)
    lines = demo._compared(tmp_path / "demo")
    assert lines[0] == "arm: hidden was joint.backlash at shoulder (gap 0.04);"
    assert "Joint shoulder has play. (gap 0.0411 rad, 0.0397 … 0.0425)" in lines[1]
    assert "Nothing is missing." in lines[3]
