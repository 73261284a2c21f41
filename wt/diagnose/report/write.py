"""A diagnosis as files: JSON, patched MJCF, report, Rerun recording, learned remainder."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from pathlib import Path

from wt.diagnose.report.handed_over import RESIDUAL
from wt.diagnose.report.page import report
from wt.diagnose.report.verify import HOLDOUT, PHYSICS
from wt.diagnose.result import Diagnosis
from wt.errors import UserError
from wt.show.files import write_together

REPORT, PLAYBACK = "report.html", "diagnosis.rrd"


def write(diagnosis: Diagnosis, out: Path) -> None:
    """Write ``diagnosis.json``, ``model.xml``, ``report.html`` and ``diagnosis.rrd`` into a folder.

    ``physics.py`` is written if MJCF cannot say all that was found, ``residual.onnx`` if there is a
    learned remainder; earlier ones go otherwise. ``holdout.npz`` lets anybody repeat the proof.
    All contents are made before the first byte is written, and renamed when all are whole, so an
    interruption leaves an earlier diagnosis as it was. Without Rerun, which the extra ``view``
    brings, there is no ``diagnosis.rrd``. If the pictures fail, the rest is written:
    what took minutes to find is not lost for them.

    Args:
        diagnosis: the findings with their proof and pictures.
        out: the folder; made if it is not there.

    Raises:
        UserError: ``out`` is a file.
        OSError: the folder cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise UserError(f"--out {out} is a file; name a folder")
    plays = importlib.util.find_spec("rerun") is not None
    data = diagnosis.to_json()
    if not plays:
        data["artifacts"]["rerun"] = None
    # JSON has no NaN; a value that is not finite would be a mistake of ours
    as_json = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)
    contents: dict[str, str | bytes] = {"model.xml": diagnosis.patched_xml}
    if diagnosis.residual_onnx:
        contents[RESIDUAL] = diagnosis.residual_onnx
    if diagnosis.physics_py:
        contents[PHYSICS] = diagnosis.physics_py
    if diagnosis.holdout_npz:
        contents[HOLDOUT] = diagnosis.holdout_npz
    last = {"diagnosis.json": as_json + "\n"}  # where it is, the rest is
    try:
        pictures: dict[str, str | bytes] = {REPORT: report(diagnosis)}
        if plays:
            from wt.diagnose.report.rerun import playback

            pictures[PLAYBACK] = playback(diagnosis)
    except Exception:
        _replace(out, {**contents, **last})
        raise
    _replace(out, {**contents, **pictures, **last})


def _replace(out: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write these, and remove what an earlier diagnosis left beside them."""
    out.mkdir(parents=True, exist_ok=True)
    write_together(out, contents)
    for name in (RESIDUAL, PHYSICS, HOLDOUT, REPORT, PLAYBACK):
        if name not in contents:
            (out / name).unlink(missing_ok=True)
