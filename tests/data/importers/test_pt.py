"""Files of torch.save: PACE's layout, any other by a map, and nothing that runs."""

from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest
import torch

from wt.cli.main import main
from wt.data.importers import base
from wt.errors import DataError

T = 0.0025 * np.arange(1000)
Q = np.stack([np.sin(T), np.cos(T)], axis=1)


def save(path: Path, **more: object) -> Path:
    content = {"time": T, "dof_pos": Q, "des_dof_pos": Q + 0.1}
    torch.save({n: torch.tensor(x, dtype=torch.float32) for n, x in content.items()} | more, path)
    return path


def test_pace(tmp_path: Path) -> None:
    r = base.read(save(tmp_path / "a.pt"), {"joints": {"joint1": "knee"}})
    assert set(r.columns) == {"qpos/joint0", "qpos/knee", "ctrl/joint0", "ctrl/knee"}
    np.testing.assert_allclose(r.columns["ctrl/knee"], np.cos(T) + 0.1, atol=1e-6)
    assert r.rate_hz == pytest.approx(400.0, rel=1e-3)
    r = base.read(save(tmp_path / "b.pt", joint_names=["hip", "knee"]))
    np.testing.assert_allclose(r.columns["qpos/hip"], np.sin(T), atol=1e-6)


def test_any_other_by_its_nested_names(tmp_path: Path) -> None:
    x = [torch.tensor(Q[:, 0]), torch.tensor(Q[:, 1])]
    content = {"log": {"stamp": torch.tensor(T), "x": x}, "dt": 0.1}
    torch.save(content, tmp_path / "a.pt")
    mapping = {"time": "log/stamp", "columns": {"qpos/a": "log/x/1"}}
    np.testing.assert_array_equal(base.read(tmp_path / "a.pt", mapping).columns["qpos/a"], Q[:, 1])


class Runs:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return builtins.eval, ("open('owned', 'w')",)


def test_nothing_is_run_and_broken_files_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match="tensors alone"):
        base.read(save(tmp_path / "a.pt", more=Runs()))
    assert not (tmp_path / "owned").exists()
    whole = save(tmp_path / "a.pt").read_bytes()
    (tmp_path / "a.pt").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match="cut off"):
        base.read(tmp_path / "a.pt")
    torch.save({"a": torch.zeros(3)}, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    with pytest.raises(DataError, match=r"since PyTorch 1\.6"):
        base.read(tmp_path / "old.pt")
    deep: object = torch.zeros(3)
    for _ in range(20):
        deep = {"in": deep}
    torch.save(deep, tmp_path / "deep.pt")
    with pytest.raises(DataError, match="nested more than 8"):
        base.read(tmp_path / "deep.pt")


def test_without_torch_one_line_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = builtins.__import__

    def absent(name: str, *rest: object) -> object:
        if name == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
        return real(name, *rest)  # type: ignore[arg-type]

    save(tmp_path / "a.pt")
    monkeypatch.setattr(builtins, "__import__", absent)
    assert main(["import", str(tmp_path / "a.pt"), "--to", str(tmp_path / "a.parquet")]) != 0
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "'torch'" in said
    assert "[fit]" in said
