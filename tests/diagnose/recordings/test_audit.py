"""A diagnosis begins with the audit, goes on with what it corrected, and says so first."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.check.machines import MACHINES, clock, record, times, with_columns, write_model
from wt.diagnose.pipeline import diagnose
from wt.diagnose.recordings.prepare import prepare
from wt.diagnose.report import text
from wt.diagnose.report.page import report
from wt.errors import RecordingError
from wt.mjcf.edit import patched_xml
from wt.physics.scene import Scene


def test_recordings_are_prepared_as_corrected(tmp_path: Path) -> None:
    clean = record("planar", 60)
    spoiled = times(-1.0, "qpos/knee", "qvel/knee")(clock(lambda t: 1e3 * t)(clean))
    prepared = prepare(Scene(write_model("planar", tmp_path)), [spoiled], [])
    assert [f.kind for f in prepared.audit] == ["time_unit", "encoder_sign"]
    ready = prepared.fit[0].recording
    np.testing.assert_allclose(ready.t, clean.t)
    np.testing.assert_allclose(ready.columns["qpos/knee"], clean.columns["qpos/knee"])
    assert prepared.used[0].rate_hz == pytest.approx(100.0)


def test_another_unit_beyond_the_limits_is_refused_with_the_way_out(tmp_path: Path) -> None:
    path = tmp_path / "m.xml"
    path.write_text(MACHINES["planar"].xml.replace('name="knee"', 'name="knee" range="-2 2"'))
    degrees = times(180 / np.pi, "qpos/knee", "qvel/knee")(record("planar", 61))
    with pytest.raises(RecordingError, match=r"qpos/knee.*degrees.*wt check .*--fix"):
        prepare(Scene(path), [degrees], [])


def test_a_model_is_amended_in_the_users_text(tmp_path: Path) -> None:
    path = write_model("planar_torque", tmp_path)
    path.write_text(path.read_text().replace("<worldbody>", "<!-- mine --><worldbody>"))

    def compensate(spec: mujoco.MjSpec) -> None:
        spec.body("a").gravcomp = 1.0

    scene = Scene(path, [compensate])
    body = scene.model.body("a").id
    assert scene.model.body_gravcomp[body] == 1.0
    written = patched_xml(scene, (), ())
    assert "<!-- mine -->" in written
    assert mujoco.MjModel.from_xml_string(written).body_gravcomp[body] == 1.0


def test_nothing_is_claimed_from_commands_that_are_measurements(tmp_path: Path) -> None:
    r = record("planar", 62, seconds=6.0)
    measured = {f"ctrl/{j}_m": r.columns[f"qpos/{j}"] for j in ("hip", "knee")}
    found = diagnose(write_model("planar", tmp_path), [with_columns(r, measured)])
    (entry,) = found.to_json()["audit"]
    assert entry["kind"] == "command_is_measured"
    assert entry["columns"] == ["ctrl/hip_m", "ctrl/knee_m"]
    assert found.verdict == "unexplained"
    assert not found.findings
    first = text.sentences(found)[0]
    assert first.startswith("'ctrl/hip_m' equals the measured position")
    assert "equals the measured position" in report(found)
