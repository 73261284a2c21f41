"""A machine that nothing holds, from the recordings to the files: silence where nothing is hidden.

In a file of its own, as it takes as long as all other tests of such machines do.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from tests.physics import stool
from wt.diagnose.pipeline import diagnose
from wt.diagnose.report.write import write


@pytest.mark.long
def test_a_whole_diagnosis_is_silent_where_nothing_is_hidden(tmp_path: Path) -> None:
    machine = stool.scene(tmp_path)
    fit, held_out = (stool.recording(seed, seconds=5.0) for seed in (1, 3))
    found = diagnose(machine.path, [fit], [held_out])
    assert found.verdict == "no_mismatch" and not found.findings
    write(found, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    assert model.joint("root").type == mujoco.mjtJoint.mjJNT_FREE
    assert "root/x" not in (tmp_path / "out" / "report.html").read_text().split("<svg")[1]
