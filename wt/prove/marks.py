"""Marking of a case: its answer, every contender's diagnosis, and the replays of all models."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco

from wt.physics.quiet import quiet
from wt.prove import machine, replay
from wt.prove.answer import Answer
from wt.prove.blind import RAN, inputs
from wt.prove.case_result import CaseResult, ContenderResult
from wt.prove.fleet_marks import mark_fleet
from wt.prove.real import REAL
from wt.prove.score import mark

_SAID = ("effect", "at", "parameters")  # of a finding that a trial keeps


@quiet()  # bad models explode, and their error says it
def mark_case(case: Path, name: str, answer: Answer, folders: Mapping[str, Path]) -> CaseResult:
    """Mark one case.

    Args:
        case: its folder.
        name: its name while it was sealed.
        answer: the hidden effects.
        folders: contender → folder of its diagnosis.
    """
    names = machine.of_model(case / "robot.xml")
    held_out = inputs(case)[1]
    recordings = replay.read(case / "robot.xml", held_out)
    before = replay.rmse(case / "robot.xml", recordings) if held_out else math.nan
    noise = _rms(answer.noise_rms.values())
    return CaseResult(
        id=name,
        name=answer.name,
        kind=answer.kind,
        rig=answer.rig,
        decoy=answer.decoy,
        level=answer.level,
        truth=answer.truth,
        visibility=tuple(v if math.isfinite(v) else None for v in answer.visibility),
        noise_rms=noise if math.isfinite(noise) else None,
        published_rmse=answer.published_rmse,
        known=answer.known,
        before_rmse=before,
        contenders={who: _result(folder, answer, names) for who, folder in folders.items()},
        after_rmse={
            who: _after(folder, recordings, before, answer.kind == REAL)
            for who, folder in folders.items()
        },
    )


def _result(folder: Path, answer: Answer, names: machine.Machine) -> ContenderResult:
    """The result of one contender; an error is an empty diagnosis, and a wrong one."""
    ran = json.loads((folder / RAN).read_text())
    diagnosis = _diagnosis(folder)
    return ContenderResult(
        seconds=float(ran["seconds"]),
        error=ran["error"],
        findings=tuple({key: f[key] for key in _SAID if key in f} for f in diagnosis["findings"]),
        marks=mark(diagnosis, answer.truth, names, answer.excused),
        experiments=ran.get("experiments"),
        reach=float(ran.get("reach", 0.0)),
        fleet=mark_fleet(folder, answer.fleet) if answer.fleet else None,
    )


def _after(
    folder: Path, recordings: Sequence[replay.HeldOutRecording], before: float, all_files: bool
) -> float:
    """Error of the patched model; of the given one where there is none that compiles.

    Concealed effects have an element in MJCF where they count. Of real machines nobody knows: there
    all files that were handed over count.
    """
    model, physics = folder / "model.xml", folder / "physics.py"
    if not model.is_file():
        return before
    beside = physics if all_files and physics.is_file() else None
    try:
        return replay.rmse(model, recordings, _diagnosis(folder)["findings"], beside)
    except (ValueError, KeyError, mujoco.FatalError):
        return before


def _diagnosis(folder: Path) -> dict[str, Any]:
    file = folder / "diagnosis.json"
    data: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {"findings": []}
    return data


def _rms(values: Iterable[float]) -> float:
    squares = [v * v for v in values]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan
