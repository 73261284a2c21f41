"""A diagnosis as files: JSON, patched MJCF, report, Rerun recording, learned remainder."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from wt.diagnose.report.handed_over import RESIDUAL
from wt.diagnose.report.page import report
from wt.diagnose.report.verify import HOLDOUT, PHYSICS
from wt.diagnose.result import Diagnosis
from wt.errors import UserError
from wt.mjcf.bundle import ASSETS, bundled
from wt.show.files import kept, write_together

MODEL, RESULT, REPORT, PLAYBACK = "model.xml", "diagnosis.json", "report.html", "diagnosis.rrd"
OUTPUTS = (RESULT, MODEL, REPORT, PLAYBACK, PHYSICS, RESIDUAL, HOLDOUT)


@contextlib.contextmanager
def claimed(
    out: Path, inputs: Iterable[Path] = (), bundle: bool = False
) -> Iterator[Callable[[Diagnosis], None]]:
    """Keep a folder for a diagnosis that is to come, and give what writes it there.

    Whatever can be wrong with the folder is said here, before any work.

    Args:
        out: the folder; made if it is not there.
        inputs: files that the diagnosis reads.
        bundle: whether copies of the model's meshes and textures go into ``assets/``.

    Raises:
        UserError: ``out`` cannot be written into, one of its outputs is an input, or it holds
            what no ``wt diagnose`` wrote.
        WorkError: another process writes into it.
    """
    with kept(out):
        _refuse_inputs(out, inputs)
        _refuse_foreign(out)
        yield functools.partial(_write, out=out, bundle=bundle)


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
        UserError: ``out`` cannot be written into, or holds what no ``wt diagnose`` wrote.
        WorkError: another process writes into it.
    """
    with claimed(out) as write_into:
        write_into(diagnosis)


def _write(diagnosis: Diagnosis, out: Path, bundle: bool) -> None:
    plays = importlib.util.find_spec("rerun") is not None
    said = diagnosis.to_json()
    if not plays:
        said["artifacts"]["rerun"] = None
    model, assets = bundled(diagnosis.patched_xml) if bundle else (diagnosis.patched_xml, {})
    contents: dict[str, str | bytes] = {MODEL: model}
    if diagnosis.residual_onnx:
        contents[RESIDUAL] = diagnosis.residual_onnx
    if diagnosis.physics_py:
        contents[PHYSICS] = diagnosis.physics_py
    if diagnosis.holdout_npz:
        contents[HOLDOUT] = diagnosis.holdout_npz
    _copy(assets, out / ASSETS)
    try:
        pictures: dict[str, str | bytes] = {REPORT: report(diagnosis)}
        if plays:
            from wt.diagnose.report.rerun import playback

            pictures[PLAYBACK] = playback(diagnosis)
    except Exception:
        _replace(out, contents, said)
        raise
    _replace(out, {**contents, **pictures}, said)


def _copy(assets: Mapping[str, bytes], folder: Path) -> None:
    """Write copies of assets; a file that is there with other contents is not replaced."""
    if not assets:
        return
    folder.mkdir(exist_ok=True)
    for name, content in assets.items():
        path = folder / name
        if path.exists() and path.read_bytes() != content:
            raise UserError(
                f"--bundle: {path} is there and is another file than the model's; move it, or name "
                "another folder"
            )
    write_together(folder, assets)


def _replace(out: Path, contents: Mapping[str, str | bytes], said: Mapping[str, object]) -> None:
    """Write these, and remove what an earlier diagnosis left beside them."""
    wrote = {name: _sha256(content) for name, content in contents.items()}
    # JSON has no NaN; a value that is not finite would be a mistake of ours
    text = json.dumps({**said, "sha256": wrote}, indent=2, ensure_ascii=False, allow_nan=False)
    write_together(out, {**contents, RESULT: text + "\n"})  # where the last is, the rest is
    for name in OUTPUTS:
        if name not in contents and name != RESULT:
            (out / name).unlink(missing_ok=True)


def _sha256(content: str | bytes) -> str:
    raw = content.encode() if isinstance(content, str) else content
    return hashlib.sha256(raw).hexdigest()


def _refuse_inputs(out: Path, inputs: Iterable[Path]) -> None:
    outputs = {(out / name).resolve(): name for name in OUTPUTS}
    for path in inputs:
        if name := outputs.get(path.resolve()):
            raise UserError(
                f"--out {out} would replace its own input {path} by a new {name}; name another "
                "folder"
            )


def _refuse_foreign(out: Path) -> None:
    """Refuse a folder with files that are not of an earlier diagnosis, or that were changed."""
    there = sorted(p.name for p in out.iterdir() if not p.name.startswith("."))
    if not there:
        return
    wrote = _wrote(out)
    if wrote is None:
        raise UserError(
            f"--out {out} holds {there[0]}, which no wt diagnose wrote; name a new or empty folder"
        )
    for name in OUTPUTS:
        path = out / name
        if name == RESULT or name not in there or not path.is_file():
            continue
        if wrote.get(name) != _sha256(path.read_bytes()):
            raise UserError(
                f"--out {out} holds a {name} that is not the one wt diagnose wrote; move it, or "
                "name another folder"
            )


def _wrote(out: Path) -> Mapping[str, str] | None:
    """Checksums of what the diagnosis in a folder wrote; None if there is no diagnosis in it."""
    try:
        said = json.loads((out / RESULT).read_text(encoding="utf-8"))
        return {str(name): str(value) for name, value in said["sha256"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
