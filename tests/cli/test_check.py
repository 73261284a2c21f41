"""``wt check``: exit codes, what it writes, and that nothing given is ever replaced."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.check.machines import MACHINES, record, times, write_model
from wt.cli.main import main
from wt.data import recording as recordings
from wt.show import files
from wt.show.files import kept


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write_model("planar", tmp_path)


@pytest.fixture
def clean(tmp_path: Path) -> Path:
    recordings.write(record("planar", 50), tmp_path / "clean.parquet")
    return tmp_path / "clean.parquet"


@pytest.fixture
def flipped(tmp_path: Path) -> Path:
    recordings.write(
        times(-1.0, "qpos/knee", "qvel/knee")(record("planar", 50)), tmp_path / "log.parquet"
    )
    return tmp_path / "log.parquet"


def test_clean(model: Path, clean: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(model), str(clean)]) == 0
    assert "Clean" in capsys.readouterr().out
    assert main(["check", str(clean)]) == 0
    assert main(["check", str(model)]) == 0


def test_found(model: Path, flipped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(model), str(flipped), "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)
    assert found["kind"] == "encoder_sign"
    assert found["columns"] == ["qpos/knee", "qvel/knee"]
    assert found["elements"] == ["joint knee"]
    assert found["fix"] == "signs: {qpos/knee: -1, qvel/knee: -1}"
    assert 0.9 < found["confidence"] <= 1.0


@pytest.mark.parametrize(
    "arguments",
    [["nothing.parquet"], ["nothing.xml"], ["a.xml", "b.xml"], ["{model}", "{model}"],
     ["{model}", "{clean}", "--fix"], ["{other}", "{clean}"], []],
    ids=["no recording", "no model", "two models", "twice", "fix without out", "other", "none"],
)  # fmt: skip
def test_what_cannot_be_read(
    arguments: list[str],
    model: Path,
    clean: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    names = {"model": model, "clean": clean, "other": write_model("arm4", tmp_path)}
    assert main(["check", *(a.format(**names) for a in arguments)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_fixed_files(model: Path, flipped: Path, tmp_path: Path) -> None:
    before = flipped.read_bytes()
    out = tmp_path / "out"
    for _ in range(2):  # what it wrote itself it may replace
        assert main(["check", str(model), str(flipped), "--fix", "--out", str(out)]) == 1
    assert flipped.read_bytes() == before
    fixed = recordings.read(out / "log.fixed.parquet")
    expected = record("planar", 50).columns["qpos/knee"]
    np.testing.assert_allclose(fixed.columns["qpos/knee"], expected, atol=1e-12)
    assert main(["check", str(model), str(out / "log.fixed.parquet")]) == 0
    page = (out / "check.html").read_text()
    assert "encoder_sign" in page
    assert page.count("<figure ") == 2
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_fixed_model(tmp_path: Path) -> None:
    xml = MACHINES["planar_torque"].xml
    path = write_model("planar_torque", tmp_path)
    robot = xml.replace("<body name=", '<body gravcomp="1" name=')
    recordings.write(record("planar_torque", 51, robot=robot), tmp_path / "log.parquet")
    out = tmp_path / "out"
    given = [str(path), str(tmp_path / "log.parquet")]
    assert main(["check", *given, "--fix", "--out", str(out)]) == 1
    fixed = out / "planar_torque.fixed.xml"
    assert mujoco.MjModel.from_xml_path(str(fixed)).body_gravcomp[1:].tolist() == [1.0, 1.0]
    assert path.read_text() == xml
    assert main(["check", str(fixed), given[1]]) == 0


@pytest.mark.parametrize("name", ["check.html", "log.fixed.parquet"])
def test_nothing_of_the_users_is_replaced(
    name: str, model: Path, flipped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert main(["check", str(model), str(flipped), "--fix", "--out", str(out)]) == 2
    assert (out / name).read_text() == "mine"
    assert name in capsys.readouterr().err


def test_recordings_of_one_name_are_both_written(
    model: Path, flipped: Path, tmp_path: Path
) -> None:
    other, out = tmp_path / "other", tmp_path / "out"
    other.mkdir()
    backwards = times(-1.0, "qpos/hip", "qvel/hip")(record("planar", 51))
    recordings.write(backwards, other / flipped.name)
    given = [str(model), str(flipped), str(other / flipped.name)]
    assert main(["check", *given, "--fix", "--out", str(out)]) == 1
    for name, seed in (("log.fixed.parquet", 50), ("log-2.fixed.parquet", 51)):
        fixed, clean = recordings.read(out / name), record("planar", seed)
        for column in ("qpos/hip", "qpos/knee"):
            np.testing.assert_allclose(fixed.columns[column], clean.columns[column], atol=1e-12)


def test_an_input_is_never_an_output(
    model: Path, flipped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was corrected once is an input like any other."""
    assert main(["check", str(model), str(flipped), "--fix", "--out", str(tmp_path)]) == 1
    fixed = tmp_path / "log.fixed.parquet"
    before = fixed.read_bytes()
    given = [str(model), str(flipped), str(fixed)]
    assert main(["check", *given, "--fix", "--out", str(tmp_path)]) == 2
    assert "is an input" in capsys.readouterr().err
    assert fixed.read_bytes() == before


def test_a_folder_that_cannot_be_used_is_refused_before_the_audit(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Even before a recording is missed."""
    (tmp_path / "taken").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "check.html").symlink_to(tmp_path / "nowhere")
    for out in ("taken", "out"):
        assert main(["check", str(model), "no.parquet", "--out", str(tmp_path / out)]) == 2
        assert "no.parquet" not in capsys.readouterr().err
    assert not (tmp_path / "nowhere").exists()


def test_a_second_audit_into_one_folder_waits_for_nothing_and_finds_nothing(
    model: Path, flipped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One says 1 where something was found, so that this is 2."""
    with kept(tmp_path / "out"):
        given = [str(model), str(flipped), "--fix", "--out", str(tmp_path / "out")]
        assert main(["check", *given]) == 2
        assert not list((tmp_path / "out").iterdir())
    assert "is being written by another wt process" in capsys.readouterr().err


def test_a_full_disk_is_no_finding(
    model: Path,
    flipped: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files, "write_together", full)
    assert main(["check", str(model), str(flipped), "--fix", "--out", str(tmp_path / "out")]) == 2
    assert "the disk is full" in capsys.readouterr().err


def test_columns_without_a_value_and_stamps_that_stand_still(
    model: Path, clean: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pq.read_table(clean)
    at, nothing = table.schema.get_field_index("qpos/knee"), pa.array(np.full(len(table), np.nan))
    pq.write_table(table.set_column(at, "qpos/knee", nothing), tmp_path / "a.parquet")
    assert main(["check", str(model), str(tmp_path / "a.parquet"), "--json"]) == 1
    said = capsys.readouterr()
    assert [(f["kind"], f["columns"]) for f in json.loads(said.out)] == [("empty", ["qpos/knee"])]
    assert not said.err
    at = table.schema.get_field_index("t")
    still = table.set_column(at, "t", pa.array(np.zeros(len(table))))
    pq.write_table(still, tmp_path / "b.parquet")
    assert main(["check", str(model), str(tmp_path / "b.parquet")]) == 2
    assert "never increases" in capsys.readouterr().err
    assert main(["check", str(model), str(clean), "--out", str(tmp_path / ("x" * 300))]) == 2


def test_stamps_that_repeat_and_go_back(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    r = record("planar", 52)
    t = r.t.copy()
    t[50], t[120] = t[49], t[110]
    pq.write_table(pa.table({"t": t, **r.columns}), tmp_path / "log.parquet")
    given = [str(model), str(tmp_path / "log.parquet")]
    assert main(["check", *given, "--json", "--fix", "--out", str(tmp_path / "out")]) == 1
    kinds = [f["kind"] for f in json.loads(capsys.readouterr().out)]
    assert kinds == ["stamps_repeated", "clock_backwards"]
    assert len(recordings.read(tmp_path / "out" / "log.fixed.parquet")) == len(r) - 2
