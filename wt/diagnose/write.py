"""A diagnosis as files: JSON, patched MJCF, report, Rerun recording, learned remainder."""

from __future__ import annotations

import json
from pathlib import Path

from wt.diagnose.playback import playback
from wt.diagnose.report import report
from wt.diagnose.result import Diagnosis
from wt.errors import UserError
from wt.show.files import write_together

RESIDUAL = "residual.onnx"


def write(diagnosis: Diagnosis, out: Path) -> None:
    """Write ``diagnosis.json``, ``model.xml``, ``report.html`` and ``diagnosis.rrd`` into a folder.

    ``residual.onnx`` is written if there is a learned remainder; an earlier one goes otherwise.
    All contents are made before the first byte is written, and renamed when all are whole, so an
    interruption leaves an earlier diagnosis as it was.

    Args:
        diagnosis: what was found.
        out: the folder; made if it is not there.

    Raises:
        UserError: ``out`` is a file.
        OSError: the folder cannot be written.
    """
    # JSON has no NaN; a value that is not finite would be a mistake of ours
    said = json.dumps(diagnosis.to_json(), indent=2, ensure_ascii=False, allow_nan=False)
    contents: dict[str, str | bytes] = {
        "model.xml": diagnosis.patched_xml,
        "report.html": report(diagnosis),
        "diagnosis.rrd": playback(diagnosis),
    }
    if diagnosis.residual_onnx:
        contents[RESIDUAL] = diagnosis.residual_onnx
    contents["diagnosis.json"] = said + "\n"  # last: where it is, the rest is
    if out.exists() and not out.is_dir():
        raise UserError(f"--out {out} is a file; name a folder")
    out.mkdir(parents=True, exist_ok=True)
    write_together(out, contents)
    if RESIDUAL not in contents:
        (out / RESIDUAL).unlink(missing_ok=True)
