"""A map of a source, proposed by its names, its motion and, if there is one, its robot's model."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from wt.data.guess import series
from wt.data.guess.clock import PLACEHOLDER_HZ, Clock, clock, rate_of
from wt.data.guess.names import match
from wt.data.guess.units import units
from wt.data.guess.words import meaning
from wt.data.importers import _mapping, _unitree, base
from wt.data.importers._survey import Quantity, Survey, Surveyor
from wt.data.recording import coordinate
from wt.errors import DataError, RecordingError
from wt.types import Recording

_MOTOR = re.compile(r"motor_(?:state|cmd)\W*(\d+)")
_AXES = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}
_SENSOR_TYPES = {
    "gyro": mujoco.mjtSensor.mjSENS_GYRO,
    "accelerometer": mujoco.mjtSensor.mjSENS_ACCELEROMETER,
}


@dataclass
class Proposal:
    """A map, with what was thought.

    Attributes:
        mapping: what ``--map`` takes.
        notes: (key of the map, name in it) → why.
        doubts: what the user has to look at.
        left_out: rows of the source that are in no column, and why.
    """

    mapping: dict[str, Any] = field(default_factory=dict)
    notes: dict[tuple[str, str], str] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)

    def say(self, key: str, name: str, value: object, note: str = "") -> None:
        """Put an entry into the map."""
        self.mapping.setdefault(key, {})[name] = value
        if note:
            self.notes[key, name] = note


def propose(path: Path, model: mujoco.MjModel | None = None) -> Proposal:
    """The map of a source that is believed, with its doubts.

    Args:
        path: a file or folder that an importer recognises.
        model: its robot, if it is known; every element has a name.

    Raises:
        DataError: the source is broken, or nothing in it can be told.
        RecordingError: what it holds is no recording, whatever the map.
    """
    proposal = Proposal()
    importer = base.importer_of(path)
    recording, named = _read(importer, path, proposal)
    if model is not None:
        renamed = _rename(recording, model, proposal)
        named = {renamed[c]: unit for c, unit in named.items() if c in renamed}
    before = base.mapped(path, proposal.mapping)
    if proposal.mapping.get("time") == {"rate": PLACEHOLDER_HZ} and (rate := rate_of(before)):
        proposal.mapping["time"] = {"rate": rate}
        proposal.notes["time", ""] = "at this rate, speeds are the slopes of their positions"
        proposal.doubts = [d for d in proposal.doubts if "no row is a time" not in d]
        before = base.mapped(path, proposal.mapping)
    found = units(before, named, model)
    for column, unit in found.units.items():
        proposal.say("units", column, unit, found.notes.get(column, ""))
    for column, sign in found.signs.items():
        proposal.say("signs", column, sign, "it runs against the slope of its position")
    proposal.doubts += found.doubts
    try:
        read = base.read(path, proposal.mapping)
    except DataError as error:
        proposal.doubts.append(f"as it stands, this map is refused: {error}")
    else:
        assumed = read.meta.get("assumed")
        proposal.doubts += [str(line) for line in assumed] if isinstance(assumed, list) else []
        proposal.doubts += base.doubts(read, proposal.mapping)
    return proposal


def _read(
    importer: base.Importer, path: Path, proposal: Proposal
) -> tuple[Recording, dict[str, str]]:
    """What the source holds under its own names, and the units that those say."""
    own = proposal.mapping
    try:
        return importer.read(path, own), {}
    except (DataError, RecordingError) as error:
        if "episode" in importer.keys and "episode: N" in str(error):
            own["episode"] = 0
            proposal.doubts.append("there are several episodes: 0 is the first of most")
            try:
                return importer.read(path, own), {}
            except (DataError, RecordingError):
                pass
        if not isinstance(importer, Surveyor):
            raise
    named = _describe(importer.survey(path, own), proposal)
    if not own.get("columns"):
        names = ", ".join(proposal.left_out) or "none"
        raise DataError(f"'{path}': no row says by its name or its motion what it is: {names}")
    return importer.read(path, own), named


def _describe(survey: Survey, proposal: Proposal) -> dict[str, str]:
    """Put ``time`` and ``columns`` into the map; column → the unit that its name says."""
    time: Clock | None = None if survey.timed else clock(survey)
    if time is not None:
        proposal.mapping["time"] = time.entry
        proposal.notes["time", ""] = time.note
        proposal.doubts += time.doubts
    named: dict[str, str] = {}
    silent: list[Quantity] = []
    rest = [q for q in survey.quantities if time is None or q is not time.quantity]
    motors = _motors(rest, proposal)
    for quantity in rest:
        said = meaning(quantity.name)
        if (slot := _MOTOR.search(quantity.name)) is not None and said.kind not in (None, "other"):
            if int(slot[1]) not in motors:
                proposal.left_out[quantity.name] = "an empty slot"
                continue
            said = replace(said, stem=motors[int(slot[1])])
        if said.kind is None:
            silent.append(quantity)
        elif said.kind in _SENSOR_TYPES:
            _sensor(proposal, quantity, said.kind, said.stem)
        elif said.kind in ("time", "other"):
            proposal.left_out[quantity.name] = "no column of a recording"
        else:
            column = f"{said.kind}/{_joint(said.stem)}"
            if _put(proposal, column, quantity, said.of) and said.unit:
                named[column] = said.unit
    if time is not None and time.quantity is not None:
        _by_motion(proposal, time.quantity, silent)
    proposal.left_out |= {q.name: f"{_range(q)}: what is it?" for q in silent}
    return named


def _by_motion(proposal: Proposal, time: Quantity, silent: list[Quantity]) -> None:
    """Put what the motion tells of quantities whose names say nothing into the map, out of these.

    Nothing is told where names have said what a position is.
    """
    if any(name.startswith("qpos/") for name in proposal.mapping.get("columns", {})):
        return
    told = series.kinds(time.values, silent)
    for kind, joint, quantity in told:
        _put(proposal, f"{kind}/{joint}", quantity, None)
        proposal.notes["columns", f"{kind}/{joint}"] = f"{_range(quantity)}, by its motion"
        silent.remove(quantity)
    if told:
        proposal.doubts.append("names say nothing: what is what was told by the motion alone")


def _motors(quantities: list[Quantity], proposal: Proposal) -> dict[int, str]:
    """Unitree's numbers of motors → joints; those that are zero throughout are empty."""
    found = [(slot, q) for q in quantities if (slot := _MOTOR.search(q.name))]
    used = sorted(
        {int(slot[1]) for slot, q in found if slot[0].startswith("motor_state") and q.values.any()}
    )
    if used:
        proposal.doubts.append(
            f"motor_state has {len(used)} motors; names are those of Unitree's SDK where 12 or 29 "
            "are used: see that they are this robot's"
        )
    return _unitree.joint_names(used)


def _put(proposal: Proposal, column: str, quantity: Quantity, of: str | None) -> bool:
    """Put a column into the map, unless another quantity is it already."""
    columns = proposal.mapping.setdefault("columns", {})
    if column in columns:
        first = next(iter(columns[column].values()))
        proposal.left_out[quantity.name] = f"{column} is {first} already"
        return False
    note = _range(quantity)
    if of in ("qvel", "force"):
        note += f"; a command of {'speed' if of == 'qvel' else 'torque'}"
    columns[column] = dict(quantity.entry)
    proposal.notes["columns", column] = note
    return True


def _sensor(proposal: Proposal, quantity: Quantity, kind: str, stem: str) -> None:
    axis = next((_AXES[word] for word in reversed(stem.split("_")) if word in _AXES), None)
    if axis is None:
        proposal.left_out[quantity.name] = f"{kind}: which axis?"
    else:
        _put(proposal, f"sensor/{kind}/{axis}", quantity, None)


def _joint(stem: str) -> str:
    return stem if stem and not stem.isdigit() else f"joint{stem}"


def _range(quantity: Quantity) -> str:
    values = quantity.values[np.isfinite(quantity.values)]
    return f"{values.min():.4g} … {values.max():.4g}" if len(values) else "no number"


def _rename(recording: Recording, model: mujoco.MjModel, proposal: Proposal) -> dict[str, str]:
    """Give columns the model's names; column → its new name."""
    split = [column.split("/", 1) for column in recording.columns if "/" in column]
    joints = list(dict.fromkeys(n for k, n in split if k[0] == "q" and coordinate(n) is None))
    driven = list(dict.fromkeys(n for kind, n in split if kind in ("ctrl", "force")))
    found = match(joints, driven, model)
    proposal.doubts += found.doubts
    sections: dict[str, dict[str, str | None]] = {
        "joints": {n: found.joints.get(n) for n in joints} | _bases(recording, model, proposal),
        "commands": {n: found.commands.get(n) for n in driven},
        "sensors": _sensors(recording, model, proposal),
    }
    renamed: dict[str, str] = {}
    for column in recording.columns:
        kind, _, name = column.partition("/")
        section = _mapping.SECTION.get(kind, "sensors")
        whole, _, tail = name.partition("/")
        key = name if name in sections[section] else whole
        new = sections[section].get(key)
        if new is not None:
            renamed[column] = f"{kind}/{new}" + (f"/{tail}" if key == whole != name else "")
    if "columns" in proposal.mapping:
        _rename_columns(proposal, renamed)
    else:
        for section, names in sections.items():
            for name, new in names.items():
                if new != name:
                    proposal.say(section, name, new)
    return renamed


def _rename_columns(proposal: Proposal, renamed: dict[str, str]) -> None:
    columns = proposal.mapping["columns"]
    proposal.mapping["columns"] = {}
    for column, entry in columns.items():
        note = proposal.notes.pop(("columns", column), "")
        if column in renamed:
            proposal.say("columns", renamed[column], entry, note)
        else:
            proposal.left_out[str(next(iter(entry.values())))] = f"{column} is not in the model"


def _bases(
    recording: Recording, model: mujoco.MjModel, proposal: Proposal
) -> dict[str, str | None]:
    """A floating base's name → the model's one free joint."""
    parts = (column.split("/") for column in recording.columns if coordinate(column) is not None)
    names = dict.fromkeys(each[1] for each in parts if each[0] in ("qpos", "qvel"))
    free = [
        model.joint(i).name
        for i in range(model.njnt)
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE
    ]
    if len(names) == len(free) == 1:
        return {name: free[0] for name in names}
    proposal.doubts += [f"{name}: the model has no free joint for it" for name in names]
    return dict.fromkeys(names)


def _sensors(
    recording: Recording, model: mujoco.MjModel, proposal: Proposal
) -> dict[str, str | None]:
    """A sensor's name → the model's: of the same name, else the only one of its type."""
    names = dict.fromkeys(c.split("/")[1] for c in recording.columns if c.startswith("sensor/"))
    known = [model.sensor(i).name for i in range(model.nsensor)]
    found: dict[str, str | None] = {}
    for name in names:
        kind = next((k for k in _SENSOR_TYPES if k in name), "")
        alike = [
            k for i, k in enumerate(known) if kind and model.sensor_type[i] == _SENSOR_TYPES[kind]
        ]
        found[name] = name if name in known else alike[0] if len(alike) == 1 else None
        if found[name] is None:
            proposal.doubts.append(f"the model has no sensor, or more than one, for {name!r}")
    return found
