"""A diagnosis on disk: all files, or the earlier ones; and the names that users call."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from jaxtyping import TypeCheckError

import wt
from tests.diagnose import synthetic
from tests.show.test_files import half
from wt.diagnose.report.report import Report
from wt.diagnose.report.write import claimed, write
from wt.errors import ModelError, UserError
from wt.show import files

NAMES = ["diagnosis.json", "diagnosis.rrd", "model.xml", "report.html"]


def listing(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_every_file_is_there_and_says_the_same(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    write(synthetic.diagnosis(str(synthetic.write_model(tmp_path))), out)
    assert listing(out) == NAMES
    content = json.loads((out / "diagnosis.json").read_text())
    assert (content["schema"], content["verdict"]) == (1, "explained")
    finding = content["findings"][0]
    assert finding["at"] == {"kind": "joint", "name": "j2"}
    assert finding["parameters"]["coulomb"] == {
        "value": 0.8123, "unit": "N·m", "ci95": [0.795, 0.829],
    }  # fmt: skip
    for name in content["artifacts"].values():
        assert name is None or (out / name).is_file()
    model = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert model.dof_frictionloss[1] == synthetic.COULOMB
    assert b"Joint j2 loses" in (out / "report.html").read_bytes()


def test_a_remainder_comes_and_goes(tmp_path: Path) -> None:
    model = str(synthetic.write_model(tmp_path))
    out = tmp_path / "out"
    write(synthetic.unexplained(model), out)
    assert (out / "residual.onnx").read_bytes() == b"onnx bytes"
    assert json.loads((out / "diagnosis.json").read_text())["artifacts"]["residual"]
    write(synthetic.diagnosis(model), out)
    assert listing(out) == NAMES
    assert json.loads((out / "diagnosis.json").read_text())["artifacts"]["residual"] is None


def test_a_bundle_takes_its_meshes_along_and_loses_nobody_s(tmp_path: Path) -> None:
    model = synthetic.write_model(tmp_path)
    mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "link.obj").write_text(mesh)
    patched = (
        f'<mujoco><compiler meshdir="{tmp_path}"/><asset><mesh file="link.obj"/></asset><worldbody>'
        '<body><joint name="j"/><geom type="mesh" mesh="link"/></body></worldbody></mujoco>'
    )
    found = replace(synthetic.diagnosis(str(model)), patched_xml=patched)
    out = tmp_path / "out"
    for _ in range(2):  # again into its own folder
        with claimed(out, bundle=True) as write_into:
            write_into(found)
    assert listing(out) == ["assets", *NAMES]
    (tmp_path / "link.obj").unlink()
    assert mujoco.MjModel.from_xml_path(str(out / "model.xml")).nmesh == 1
    (tmp_path / "link.obj").write_text(mesh)
    (out / "assets" / "link.obj").write_text("mine")
    with claimed(out, bundle=True) as write_into, pytest.raises(UserError, match="another file"):
        write_into(found)
    assert (out / "assets" / "link.obj").read_text() == "mine"


@pytest.mark.parametrize("whole", range(4))
def test_an_interruption_leaves_the_earlier_diagnosis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: int
) -> None:
    """Ctrl-C in the middle of the first, second, … file."""
    model, out = str(synthetic.write_model(tmp_path)), tmp_path / "out"
    write(synthetic.unexplained(model), out)
    earlier = {p.name: p.read_bytes() for p in out.iterdir()}
    monkeypatch.setattr(files.os, "fdopen", half(KeyboardInterrupt, whole))
    with pytest.raises(KeyboardInterrupt):
        write(synthetic.nothing(model), out)
    monkeypatch.undo()
    assert {p.name: p.read_bytes() for p in out.iterdir()} == earlier


def test_a_picture_that_fails_costs_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, out = str(synthetic.write_model(tmp_path)), tmp_path / "out"
    write(synthetic.unexplained(model), out)

    def failing(_: object) -> bytes:
        raise ZeroDivisionError

    monkeypatch.setattr("wt.diagnose.report.rerun.playback", failing)
    with pytest.raises(ZeroDivisionError):
        write(synthetic.diagnosis(model), out)
    # and no earlier report stands beside the new numbers
    assert listing(out) == ["diagnosis.json", "model.xml"]
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "explained"


def test_a_file_is_not_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(UserError, match="name a folder"):
        write(synthetic.nothing(str(synthetic.write_model(tmp_path))), tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_a_diagnosis_shows_and_writes_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = Report.of(synthetic.diagnosis(str(synthetic.write_model(tmp_path))))
    found.write(str(tmp_path / "out"))
    assert listing(tmp_path / "out") == NAMES
    found.show()
    assert "Joint j2 loses 0.81 N·m" in capsys.readouterr().out
    assert "<b>Joint j2 loses 0.81\u00a0N·m" in found._repr_html_()
    assert "&amp; qpos/j1" in Report.of(synthetic.unexplained())._repr_html_()


def test_the_package_is_called_like_the_function() -> None:
    with pytest.raises(ModelError, match=r"'nowhere\.xml' does not exist"):
        wt.diagnose("nowhere.xml", ["a.parquet"])
    from wt.diagnose import diagnose

    with pytest.raises(ModelError, match=r"'nowhere\.xml' does not exist"):
        diagnose("nowhere.xml", ["a.parquet"], holdout=["b.parquet"], seed=1)
    with pytest.raises((TypeError, TypeCheckError)):
        wt.diagnose("nowhere.xml")  # type: ignore[call-arg]
    with pytest.raises(AttributeError, match="no attribute 'diagnosis'"):
        _ = wt.diagnosis  # type: ignore[attr-defined]


def test_importing_wt_loads_nothing() -> None:
    code = (
        "import sys, wt; print('wt.diagnose' in sys.modules);"
        "wt.diagnose; print('numpy' in sys.modules, 'mujoco' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "False"]


def test_what_no_diagnosis_wrote_is_never_replaced(tmp_path: Path) -> None:
    own = synthetic.write_model(tmp_path)
    out = tmp_path / "out"
    out.mkdir()
    (out / "model.xml").write_bytes(own.read_bytes())
    found = synthetic.diagnosis(str(own))
    with pytest.raises(UserError, match=r"holds model\.xml, which no wt diagnose wrote"):
        write(found, out)
    assert (out / "model.xml").read_bytes() == own.read_bytes()
    assert listing(out) == ["model.xml"]


def test_an_earlier_diagnosis_is_replaced_unless_it_was_changed(tmp_path: Path) -> None:
    model, out = str(synthetic.write_model(tmp_path)), tmp_path / "out"
    write(synthetic.unexplained(model), out)
    write(synthetic.diagnosis(model), out)
    (out / "model.xml").write_text("mine")
    with pytest.raises(UserError, match=r"model\.xml that is not the one"):
        write(synthetic.nothing(model), out)
    assert (out / "model.xml").read_text() == "mine"


def test_an_input_is_no_output(tmp_path: Path) -> None:
    model, out = str(synthetic.write_model(tmp_path)), tmp_path / "out"
    write(synthetic.diagnosis(model), out)
    inputs = [tmp_path / "a.parquet", out / ".." / "out" / "model.xml"]
    with pytest.raises(UserError, match="would replace its own input"), claimed(out, inputs):
        pass
