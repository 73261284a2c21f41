"""``wt diagnose``: what it prints and writes, and its exit codes; the analysis is replaced."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.diagnose import synthetic
from wt.cli.diagnose import repeated
from wt.cli.main import main
from wt.data import recording as recordings
from wt.diagnose import pipeline
from wt.diagnose.pace import Expected
from wt.diagnose.result import Diagnosis
from wt.diagnose.stop import stopped
from wt.errors import RecordingError
from wt.types import Recording

FILES = ["diagnosis.json", "diagnosis.rrd", "model.xml", "report.html"]


class Analysis:
    """Stands in for the analysis: keeps what it was asked and answers what it is told to."""

    def __init__(self) -> None:
        self.answer: Callable[[str], Diagnosis] = synthetic.diagnosis
        self.error: BaseException | None = None
        self.asked: dict[str, Any] = {}
        self.expected: Expected | None = None

    def __call__(
        self,
        model: Path,
        recordings: Sequence[Path],
        holdout: Sequence[Path] = (),
        **rest: Any,  # noqa: ANN401 – only kept
    ) -> Diagnosis:
        self.asked = {"model": model, "recordings": recordings, "holdout": holdout, **rest}
        if self.expected:
            rest["expect"](self.expected)
        rest["progress"]("screening", 0.5)
        if self.error:
            raise self.error
        return self.answer(str(model))


@pytest.fixture
def analysis(monkeypatch: pytest.MonkeyPatch) -> Analysis:
    stand_in = Analysis()
    monkeypatch.setattr(pipeline, "diagnose", stand_in)
    monkeypatch.setenv("WT_DEBUG", "0")
    monkeypatch.setenv("COLUMNS", "80")
    return stand_in


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(synthetic.write_model(tmp_path))


def listing(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_it_prints_the_answer_and_writes_the_files(
    analysis: Analysis, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["diagnose", model, "a.parquet", "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert listing(out) == FILES
    # no terminal, no bar: a plain line every ten seconds
    assert all(" % after " in line for line in printed.err.splitlines())
    lines = printed.out.splitlines()
    assert lines[0] == "Joint j2 loses 0.81 N·m to dry friction that the model leaves out."
    assert all(len(line) <= 80 for line in lines if str(out) not in line)
    row = next(line.split() for line in lines if line.startswith(" joint.friction_coulomb"))
    assert row == ["joint.friction_coulomb", "joint", "j2", "coulomb", "0.812", "N·m",
                   "0.795", "…", "0.829"]  # fmt: skip
    assert "slow reversals of j2" in " ".join(printed.out.split())
    assert lines[-1] == str(out / "report.html")


@pytest.mark.parametrize(
    ("answer", "said"),
    [(synthetic.nothing, "Nothing is missing"), (synthetic.unexplained, "An unknown force acts")],
)
def test_nothing_and_unknown_are_answers(
    analysis: Analysis,
    model: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    answer: Callable[[str], Diagnosis],
    said: str,
) -> None:
    analysis.answer = answer
    assert main(["diagnose", model, "a.parquet", "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.startswith(said)


@pytest.mark.parametrize(
    ("nothing", "each", "said"), [(1.5, 1.0, False), (4.0, 2.0, True), (9.0, 4.0, True)]
)
def test_how_long_it_takes_is_said_unless_even_an_effect_is_found_at_once(
    analysis: Analysis, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    nothing: float, each: float, said: bool,
) -> None:  # fmt: skip
    analysis.expected = Expected(nothing, each)
    assert main(["diagnose", model, "r.parquet", "--out", str(tmp_path / "out")]) == 0
    assert ("this takes about" in capsys.readouterr().err) is said


@pytest.mark.parametrize(
    "arguments",
    [
        ["{m}", "a", "b", "--holdout", "c", "d", "--out", "{o}"],
        ["{m}", "a", "b", "--holdout", "c", "--out", "{o}", "--holdout", "d"],
        ["--out", "{o}", "{m}", "a", "b", "--holdout=c", "--holdout", "d"],
        ["--seed", "0", "{m}", "a", "b", "--out={o}", "--holdout", "c", "d"],
    ],
)
def test_holdout_takes_several_in_either_way(
    analysis: Analysis, model: str, tmp_path: Path, arguments: list[str]
) -> None:
    out = str(tmp_path / "out")
    assert main(["diagnose", *(a.format(m=model, o=out) for a in arguments)]) == 0
    assert [str(p) for p in analysis.asked["recordings"]] == ["a", "b"]
    assert [str(p) for p in analysis.asked["holdout"]] == ["c", "d"]


def test_only_values_of_the_option_itself_are_repeated() -> None:
    assert repeated(["m", "--holdout", "a", "b", "--seed", "1", "c"], "--holdout") == [
        "m", "--holdout", "a", "--holdout", "b", "--seed", "1", "c",
    ]  # fmt: skip
    assert repeated(["m", "a"], "--holdout") == ["m", "a"]


def test_options_reach_the_analysis(analysis: Analysis, model: str, tmp_path: Path) -> None:
    tail = ["a", "--out", str(tmp_path / "out")]
    assert main(["diagnose", model, *tail, "--seed", "7"]) == 0
    assert analysis.asked["seed"] == 7


@pytest.mark.parametrize("seed", ["-1", "many", "1.5"])
def test_wrong_arguments_are_one_line_and_exit_2(
    analysis: Analysis, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: str
) -> None:
    out = tmp_path / "out"
    assert main(["diagnose", model, "a", "--out", str(out), f"--seed={seed}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["diagnose", model, "--out", str(out)]) == 2
    assert main(["diagnose", model, "a"]) == 2
    assert main(["diagnose", model, "a", "--out", model]) == 2
    assert "name a folder" in capsys.readouterr().err
    assert analysis.asked == {}
    assert not out.exists()


def test_bad_input_and_failures_leave_the_earlier_output(
    analysis: Analysis, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["diagnose", model, "a", "--out", str(out)]
    assert main(arguments) == 0
    earlier = {p.name: p.read_bytes() for p in out.iterdir()}
    capsys.readouterr()
    for error, code in (
        (RecordingError("'a': column 't' does not increase"), 2),
        (OSError(28, "No space left on device"), 1),
        (KeyboardInterrupt(), 1),
        (ValueError("a mistake of ours"), 1),
    ):
        analysis.error = error
        assert main(arguments) == code
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
    assert {p.name: p.read_bytes() for p in out.iterdir()} == earlier


def test_a_suggested_experiment_is_a_recording(
    analysis: Analysis, model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def suggest(diagnosis: Diagnosis, path: Path) -> Recording:
        assert (diagnosis.verdict, str(path)) == ("explained", model)
        return Recording(np.arange(300) / 100, {"ctrl/a1": np.zeros(300), "ctrl/a2": np.ones(300)})

    excite = ModuleType("wt.diagnose.experiment.excite")
    excite.suggest = suggest  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "wt.diagnose.experiment.excite", excite)
    path = tmp_path / "next" / "next.parquet"
    tail = ["--out", str(tmp_path / "out"), "--suggest-experiment", str(path)]
    assert main(["diagnose", model, "a", *tail]) == 0
    assert set(recordings.read(path).columns) == {"ctrl/a1", "ctrl/a2"}


def test_tracking_logs_what_was_found(
    analysis: Analysis, model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mlflow import MlflowClient

    store = f"sqlite:///{tmp_path}/mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store)
    assert main(["diagnose", model, "a", "--out", str(tmp_path / "out"), "--track"]) == 0
    client = MlflowClient(tracking_uri=store)
    experiment = client.get_experiment_by_name("diagnose")
    assert experiment is not None
    (run,) = client.search_runs([experiment.experiment_id])
    assert run.info.status == "FINISHED"
    assert run.data.params["verdict"] == "explained"
    assert run.data.metrics["joint.friction_coulomb/j2/coulomb"] == 0.8123
    assert run.data.metrics["holdout/noise_floor_rmse"] == 2e-4
    assert (
        sorted(f.path for f in client.list_artifacts(run.info.run_id) if f.path in FILES) == FILES
    )


@pytest.mark.parametrize("times", [pytest.param(2, marks=pytest.mark.long), 3])
def test_two_ctrl_c_write_what_is_known_and_a_third_ends_at_once(
    times: int, model: str, tmp_path: Path
) -> None:
    u = synthetic.commands(60.0, 0.0)
    q, _ = synthetic.simulate(synthetic.PATCHED, u)
    columns = {f"ctrl/a{k}": u[:, k - 1] for k in (1, 2)}
    columns |= {f"qpos/j{k}": q[:, k - 1] for k in (1, 2)}
    source, out = tmp_path / "a.parquet", tmp_path / "out"
    recordings.write(Recording(np.arange(len(u)) / synthetic.RATE, columns), source)
    words = ["diagnose", model, str(source), "--out", str(out)]
    # a machine that is busy imports slowly, and the analysis is what is to be interrupted
    begun = time.monotonic()
    subprocess.run([sys.executable, "-c", "import wt.cli.main, wt.diagnose.pipeline"], check=True)
    imports_s = time.monotonic() - begun
    started = subprocess.Popen(
        [sys.executable, "-m", "wt.cli.main", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "WT_DEBUG": "0"},
    )  # fmt: skip
    time.sleep(2.0 + 1.5 * imports_s)
    for _ in range(times):
        started.send_signal(signal.SIGINT)
        time.sleep(0.3)
    printed, err = started.communicate(timeout=120)
    # but for how long it would have taken
    once, again, *rest = (
        line for line in err.splitlines() if line and not line.startswith("this takes")
    )
    assert once.startswith("Ctrl-C once more ends the search") and again.startswith("ending")
    if times == 3:
        assert (started.returncode, printed) == (1, "")
        assert len(rest) == 1 and rest[0].startswith("error: interrupted")
        assert not out.exists()
    else:
        assert started.returncode == 0
        assert "The search was ended before its time" in printed
        written = json.loads((out / "diagnosis.json").read_text())
        assert written["verdict"] != "no_mismatch"


def test_a_time_limit_ends_the_search(
    analysis: Analysis, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def search(path: str) -> Diagnosis:
        begun = time.monotonic()
        while not stopped():
            assert time.monotonic() - begun < 60.0
            time.sleep(0.01)
        assert stopped() and time.monotonic() - begun > 0.3
        return synthetic.diagnosis(path)

    analysis.answer, out = search, str(tmp_path / "out")
    assert main(["diagnose", model, "a", "--out", out, "--time-limit", "0.01"]) == 0
    assert capsys.readouterr().err.count("the 0.01 min are over: ending the search") == 1
    assert not stopped()
    assert main(["diagnose", model, "a", "--out", out + "2", "--time-limit", "0"]) == 2
    assert "0.01" in capsys.readouterr().err


def test_why_prints_every_decision_at_a_place(
    analysis: Analysis, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    assert main(["diagnose", model, "a.parquet", "--out", out]) == 0
    capsys.readouterr()
    assert main(["diagnose", "--out", out, "--why", "j2"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "holdout stays 1.00·10⁻⁹ 0.0100 proven" in printed
    assert "replayed goes 302 812 beaten" in printed
    assert "actuator.gain" not in printed


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--why", "j9"], "--why j9: nothing was considered there; places: actuator a2, joint j2"),
        ([], "name MODEL.xml and at least one RECORDING"),
    ],
)
def test_why_says_what_it_cannot_print(
    analysis: Analysis,
    model: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    out = str(tmp_path / "out")
    assert main(["diagnose", model, "a.parquet", "--out", out]) == 0
    capsys.readouterr()
    assert main(["diagnose", "--out", out, *arguments]) == 2
    assert said in capsys.readouterr().err


def test_why_needs_a_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", "--out", str(tmp_path), "--why", "j2"]) == 2
    assert "no diagnosis with decisions" in capsys.readouterr().err
