"""``wt import``: one line, exit codes, and nothing written when it fails."""

from __future__ import annotations

from pathlib import Path

import pytest

from wt.cli.main import main
from wt.data import recording as recordings


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
