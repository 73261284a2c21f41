"""The demonstration keeps to its folder and does not do again what is done."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

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
    started = subprocess.Popen

    def start(command: list[str], **options: Any) -> subprocess.Popen[str]:  # noqa: ANN401 – passed on
        assert "MLFLOW_TRACKING_URI" not in options["env"] and options["cwd"] == folder
        ran.append(" ".join(command[3:]))
        return started([sys.executable, "-c", "print('done')"], **options)

    monkeypatch.setattr(subprocess, "Popen", start)
    demo.prepare(folder)
    for lane in demo.lanes(folder):
        for step in lane:
            demo._run(folder, step, said.append, print)
            product = folder / step.product
            product.parent.mkdir(exist_ok=True)
            product.touch()
            demo._run(folder, step, said.append, print)
    assert [words.split()[0] for words in ran] == ["diagnose", "diagnose", "fit"]
    assert said[0].startswith("\n$ wt diagnose examples/arm/model.xml examples/arm/1.parquet")


def test_a_step_that_fails_says_why_in_one_line(tmp_path: Path) -> None:
    step = demo.Step(("wt", "diagnose", "none.xml", "none.parquet", "--out", "x"), "x")
    with pytest.raises(WorkError, match=r"failed: .*none"):
        demo._run(tmp_path, step, print, print)


def test_how_far_a_step_is_is_noted_while_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted, said, started = list[str](), list[str](), subprocess.Popen
    code = "import sys; print('naming: 80 %', file=sys.stderr); print('done')"
    stand_in = [sys.executable, "-c", code]
    monkeypatch.setattr(subprocess, "Popen", lambda _, **options: started(stand_in, **options))
    step = demo.diagnosis_of("arm")
    demo._run(tmp_path, step, said.append, noted.append)
    assert noted == ["arm: naming: 80 %"] and said == [f"\n$ {step}\ndone"]


def test_what_is_left_to_the_user_is_a_command_on_an_example(tmp_path: Path) -> None:
    demo.prepare(tmp_path / "demo")
    *_, line = demo._to_open(tmp_path / "demo")
    change, command = line.strip().split(" && ")
    assert change == f"cd {tmp_path / 'demo'}"
    model, *recordings = command.split()[2:5]
    assert command.startswith("wt diagnose examples/go2/") and len(recordings) == 2
    assert all((tmp_path / "demo" / file).is_file() for file in (model, *recordings))


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
