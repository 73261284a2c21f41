"""A form and the map that it says, there and back; and what an audit proposes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.check.machines import record, with_columns, write_model
from wt.check.run import check
from wt.data import recording as recordings
from wt.data.guess.propose import propose
from wt.data.importers import base
from wt.physics.scene import Scene
from wt.studio import mapping as maps
from wt.studio.mapping import Form, Row
from wt.types import Recording

ROWS = (
    Row("qpos/a", "qpos/b", "deg", 2.0, True, 0.25),
    Row("qpos/b", "qpos/a", "mm"),
    Row("qvel/a", None),
    Row("ctrl/u", "ctrl/u", "SI", 0.5),
    Row("force/u", "force/u"),
)
T = 0.01 * np.arange(300)


def test_a_form_and_its_map_say_the_same(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    raw = {row.source: np.sin((i + 1) * T) for i, row in enumerate(ROWS)}
    recordings.write(Recording(T, raw), path)
    mapping = maps.content(Form(False, ROWS))
    made, _ = maps.read(path, mapping)
    assert list(made.columns) == ["qpos/b", "qpos/a", "ctrl/u", "force/u"]
    np.testing.assert_allclose(
        made.columns["qpos/b"], -2.0 * np.deg2rad(raw["qpos/a"]) + 0.25, atol=1e-12
    )
    np.testing.assert_allclose(made.columns["qpos/a"], 1e-3 * raw["qpos/b"])
    again = maps.filled(maps.offered(path), mapping)
    assert maps.content(again) == mapping
    assert maps.content(maps.offered(path)) == {}


def test_a_table_and_its_map_say_the_same(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("ms,x,y,note\n" + "".join(f"{10 * k},{k},{-k},1\n" for k in range(300)))
    as_it_stands = maps.offered(path)
    assert [r.source for r in as_it_stands.rows] == ["ms", "x", "y", "note"]
    changes = ({"channel": "t", "factor": 1e-3}, {"channel": "qpos/a", "unit": "mm"},
               {"channel": "ctrl/u"}, {})  # fmt: skip
    rows = [replace(r, **c) for r, c in zip(as_it_stands.rows, changes, strict=True)]
    form = replace(as_it_stands, rows=tuple(rows))
    mapping = maps.content(form)
    made, _ = maps.read(path, mapping)
    np.testing.assert_allclose(made.t, T)
    np.testing.assert_allclose(made.columns["qpos/a"], 1e-3 * np.arange(300))
    assert maps.filled(as_it_stands, mapping) == form
    untimed = replace(form, rows=(replace(rows[0], channel=None, factor=1.0), *rows[1:]), rate=50.0)
    mapping = maps.content(untimed)
    assert mapping["time"] == {"rate": 50.0}
    assert maps.read(path, mapping)[0].rate_hz == pytest.approx(50.0)
    assert maps.filled(as_it_stands, mapping) == untimed


def test_an_archive_is_guessed_as_the_command_does(tmp_path: Path) -> None:
    """Names of a log become those of the model; what comes out is what its map says."""
    clean, model = record("planar", 3), write_model("planar", tmp_path)
    q = np.stack([clean.columns["qpos/hip"], clean.columns["qpos/knee"]], axis=1)
    np.savez(
        tmp_path / "a.npz", time=clean.t, joint_positions=np.rad2deg(q),
        hip_target=next(c for n, c in clean.columns.items() if n.startswith("ctrl/")),
    )  # fmt: skip
    path = tmp_path / "a.npz"
    given = Scene(model).given
    form, _ = maps.guessed(path, maps.offered(path), given)
    made, _ = maps.read(path, maps.content(form), even_if=True)
    told, _ = maps.read(path, propose(path, given).mapping, even_if=True)
    assert set(made.columns) == set(told.columns)
    for name, values in told.columns.items():
        np.testing.assert_allclose(made.columns[name], values)


@pytest.mark.parametrize(
    "broken",
    [
        {"qpos/hip": ("qpos/knee", 1.0), "qpos/knee": ("qpos/hip", 1.0)},
        {"qpos/hip": ("qpos/hip", -1.0), "qvel/hip": ("qvel/hip", -1.0)},
        {"qvel/knee": ("qvel/knee", 180.0 / np.pi)},
    ],
    ids=["swapped", "reversed", "degrees"],
)
def test_what_the_check_proposes_mends_the_log(
    tmp_path: Path, broken: dict[str, tuple[str, float]]
) -> None:
    clean = record("planar", 3)
    columns = {name: f * clean.columns[source] for name, (source, f) in broken.items()}
    path, model = tmp_path / "a.parquet", write_model("planar", tmp_path)
    recordings.write(with_columns(clean, columns), path)
    findings = check(Scene(model), recordings.read(path)).findings
    form = maps.proposed(maps.offered(path), findings)
    assert form != maps.offered(path)
    made = base.read(path, maps.content(form))
    for name in broken:
        np.testing.assert_allclose(made.columns[name], clean.columns[name], rtol=1e-4, atol=1e-9)


def test_proposals_join_what_the_map_says_already() -> None:
    from wt.check.finding import AuditFinding

    def finding(fix: str, confidence: float = 1.0) -> AuditFinding:
        return AuditFinding("a", ("qpos/b",), (), "", fix, confidence)

    form = Form(False, ROWS)
    (row, *others) = maps.proposed(form, [finding("signs: {qpos/b: -1}")]).rows
    assert row == replace(ROWS[0], reversed=False, offset=-0.25) and tuple(others) == ROWS[1:]
    (row, *_) = maps.proposed(form, [finding("units: {qpos/b: 10}, offsets: {qpos/b: 1}")]).rows
    assert row == replace(ROWS[0], factor=20.0, offset=3.5)
    assert (
        maps.proposed(form, [finding("signs: {qpos/b: -1}", 0.5), finding("record anew")]) == form
    )
