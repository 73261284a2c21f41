"""One row for every case: what was hidden, what everybody said, and the marks for it."""

from __future__ import annotations

import dataclasses
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
from wt.prove.score import mark

Row = dict[str, Any]


@quiet()  # bad models explode, and their error says it
def row(case: Path, name: str, answer: Answer, said: Mapping[str, Path]) -> Row:
    """Mark one case; plain JSON, with None for what is not a number.

    Args:
        case: its folder.
        name: its name while it was sealed.
        answer: what is hidden.
        said: who → folder of what that one said.
    """
    names = machine.of_model(case / "robot.xml")
    measured = replay.read(case / "robot.xml", inputs(case)[1])
    found = answer.to_json()
    before = replay.rmse(case / "robot.xml", measured)
    return finite(
        {
            "id": name,
            **{key: found[key] for key in ("name", "kind", "rig", "decoy", "level", "truth")},
            "noise_rms": _rms(answer.noise_rms.values()),
            "before_rmse": before,
            "said": {who: _entry(folder, answer, names) for who, folder in said.items()},
            "after_rmse": {who: _after(folder, measured, before) for who, folder in said.items()},
        }
    )


def _entry(folder: Path, answer: Answer, names: machine.Machine) -> Row:
    """What one contender said of a case; an error is an empty answer, and a wrong one."""
    ran = json.loads((folder / RAN).read_text())
    diagnosis = _diagnosis(folder)
    return {
        "seconds": ran["seconds"],
        "error": ran["error"],
        "findings": [
            {"effect": finding["effect"], "at": finding["at"]} for finding in diagnosis["findings"]
        ],
        "marks": dataclasses.asdict(mark(diagnosis, answer.truth, names, answer.excused)),
    }


def _after(folder: Path, measured: Sequence[replay.HeldOutRecording], before: float) -> float:
    """Error of the patched model; of the given one where there is none that compiles."""
    if not (folder / "model.xml").is_file():
        return before
    try:
        return replay.rmse(folder / "model.xml", measured, _diagnosis(folder)["findings"])
    except (ValueError, KeyError, mujoco.FatalError):
        return before


def _diagnosis(folder: Path) -> dict[str, Any]:
    file = folder / "diagnosis.json"
    found: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {"findings": []}
    return found


def _rms(values: Iterable[float]) -> float:
    every = list(values)
    return math.sqrt(sum(v * v for v in every) / len(every)) if every else math.nan


def finite(value: Any) -> Any:  # noqa: ANN401 – any JSON
    """JSON with None for what is no finite number."""
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
