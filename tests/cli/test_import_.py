"""``wt import``: one line, exit codes, and nothing written when it fails."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from wt.cli.main import main
from wt.data import recording as recordings
from wt.show import files


@pytest.fixture
def source(tmp_path: Path) -> Path:
    rows = [f"{0.02 * k},{(k // 40) % 2},{(max(k - 5, 0) // 40) % 2}" for k in range(400)]
    (tmp_path / "log.csv").write_text("time,u,x\n" + "\n".join(rows) + "\n")
    (tmp_path / "map.yaml").write_text("time: time\ncolumns: {ctrl/a: u, qpos/a: x}\n")
    return tmp_path / "log.csv"


def test_a_recording_and_one_line(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = source.with_name("out.parquet")
    mapped = ["--map", str(source.with_name("map.yaml"))]
    assert main(["import", str(source), "--to", str(out), *mapped]) == 0
    line = capsys.readouterr().out
    assert "2 columns, 8.0 s at 50.00 Hz" in line
    assert "delay 100 ms" in line
    assert line.count("\n") == 1
    assert len(recordings.read(out)) == 400


def test_bad_input_is_exit_2_and_one_line(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = source.with_name("out.parquet")
    for arguments in ([str(source)], [str(source.with_name("missing"))], [str(source.parent)]):
        assert main(["import", *arguments, "--to", str(out)]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


def test_what_another_import_wrote_meanwhile_is_not_lost(
    source: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, link = source.with_name("out.parquet"), files.os.link

    def after_another(part: Path, path: Path) -> None:
        path.write_bytes(b"another's")
        link(part, path)

    monkeypatch.setattr(files.os, "link", after_another)
    mapped = ["--map", str(source.with_name("map.yaml"))]
    assert main(["import", str(source), "--to", str(out), *mapped]) == 1
    assert "was written by another process meanwhile" in capsys.readouterr().err
    assert out.read_bytes() == b"another's"
    assert not list(out.parent.glob(".*.part"))


def test_where_nothing_can_be_written_is_said_before_anything_is_read(
    source: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def read(*_: object) -> None:
        raise AssertionError("it was read")

    monkeypatch.setattr("wt.data.importers.base.read", read)
    mapped = ["--map", str(source.with_name("map.yaml"))]
    for out in (source / "x.parquet", source.parent / ("y" * 300) / "x.parquet"):
        assert main(["import", str(source), "--to", str(out), *mapped]) == 2
        line = capsys.readouterr().err
        assert line.startswith("error: --to ") and line.count("\n") == 1 and ".part" not in line


def test_a_planted_link_is_neither_followed_nor_lost(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, precious = source.with_name("out.parquet"), source.with_name("precious")
    out.symlink_to(precious)  # to what is not there yet
    mapped = ["--map", str(source.with_name("map.yaml"))]
    assert main(["import", str(source), "--to", str(out), *mapped]) == 1
    assert not precious.exists() and out.is_symlink()


def test_the_robots_mjcf_beside_it(
    shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = {"a": "dfki_double_pendulum/c1_143906", "b": "bam_xl330/kp200_sin_sin.json",
               "c": "so101/step_response"}  # fmt: skip
    for name, source in sources.items():
        out, model = tmp_path / f"{name}.parquet", tmp_path / f"{name}.xml"
        path = str(shared / "recordings" / source)
        assert main(["import", path, "--to", str(out), "--model", str(model)]) == 0
        loaded = mujoco.MjModel.from_xml_path(str(model))
        recordings.check_against(recordings.read(out), loaded)
    assert capsys.readouterr().err == ""


def test_a_format_without_a_robot_has_no_mjcf(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, model = source.with_name("out.parquet"), source.with_name("out.xml")
    mapped = ["--map", str(source.with_name("map.yaml"))]
    assert main(["import", str(source), "--to", str(out), *mapped, "--model", str(model)]) == 2
    assert "leave --model out" in capsys.readouterr().err
    assert not model.exists()
    assert not out.exists()


def test_doubts_are_said_and_the_recording_is_written(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source.write_text(
        "\n".join(["time,u,x", *(f"{0.02 * k},{k % 97},{57.0 * (k % 97)}" for k in range(400))])
    )
    out = source.with_name("out.parquet")
    mapped = ["--map", str(source.with_name("map.yaml"))]
    assert main(["import", str(source), "--to", str(out), *mapped]) == 0
    said = capsys.readouterr().err
    assert "note: column 'qpos/a' may be in degrees" in said
    assert out.exists()


def test_an_input_is_never_an_output(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, map_file = source.read_bytes(), source.with_name("map.yaml")
    mapped = ["--map", str(map_file)]
    foreign = source.with_name("notes.txt")
    foreign.write_text("mine")
    for to in (source, map_file, foreign):
        assert main(["import", str(source), *mapped, "--to", str(to)]) == 2
        assert "name another file" in capsys.readouterr().err
    assert (source.read_bytes(), foreign.read_text()) == (before, "mine")
    out = source.with_name("out.parquet")
    for _ in range(2):  # its own earlier output may go
        assert main(["import", str(source), *mapped, "--to", str(out)]) == 0


def test_labels_go_into_the_metadata_of_a_log_and_of_a_recording(source: Path) -> None:
    first, second = (source.with_name(f"{n}.parquet") for n in ("first", "second"))
    mapped = ["--map", str(source.with_name("map.yaml")), "--unit", "A17"]
    assert main(["import", str(source), "--to", str(first), *mapped]) == 0
    assert recordings.read(first).meta["unit"] == "A17"
    labels = ["--session", "2026-11-25", "--load", "none"]
    assert main(["import", str(first), "--to", str(second), *labels]) == 0
    meta = recordings.read(second).meta
    assert (meta["unit"], meta["session"], meta["load"]) == ("A17", "2026-11-25", "none")


def test_labels_that_are_none_are_one_line(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = source.with_name("out.parquet")
    for bad in (["--unit", "a b"], ["--session", "25.11."], ["--load", ""]):
        assert main(["import", str(source), "--to", str(out), *bad]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert main(["import", str(source), "--guess", "--unit", "A17"]) == 2
    assert "leave --unit out" in capsys.readouterr().err
    assert not out.exists()
