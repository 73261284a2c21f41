"""Recordings on disk: one Parquet file each, read, written whole, and checked against an MJCF.

The format is that of :class:`wt.types.Recording`: float64 columns, NaN for a missing sample, SI
units and radians, with free metadata as JSON under the file's key ``wt``.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float

from wt.errors import RecordingError, UserError, suggest
from wt.show.files import write_new, write_whole
from wt.types import Recording

META_KEY = b"wt"
DEGREE = np.pi / 180.0
_COPIES, _COPIES_OF_WORK, _SHARE_OF_MEMORY = 8, 16, 0.7
"""Copies that reading a log keeps, and smoothing a recording; share of the memory for them."""
_MOST = 10_000_000
"""Numbers that are worked on at once: an audit takes 2 µs for each, the smoothing of a diagnosis 5,
and neither learns more of a machine from a longer recording."""
_BEYOND = 0.5  # rad past a limit: more than any sensor offset or compliance explains
_TURN = 2.0 * np.pi  # rad: what stays inside may as well be radians


def read(path: str | Path) -> Recording:
    """Read one recording.

    Args:
        path: a Parquet file of the recording format.

    Raises:
        RecordingError: the file is missing, truncated, not Parquet, or not a recording.
    """
    columns, meta = table(path)
    try:
        return Recording(columns.pop("t"), columns, meta)
    except RecordingError as error:
        raise RecordingError(f"'{path}': {error}") from error


def table(path: str | Path) -> tuple[dict[str, Float[np.ndarray, " sample"]], dict[str, Any]]:
    """The columns of a recording's file, ``t`` among them, and its metadata, as they stand.

    Args:
        path: a Parquet file of the recording format.

    Raises:
        RecordingError: the file is missing, truncated, not Parquet, or not of this format.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(
            f"recording '{path}' does not exist; give a .parquet file, or make one with "
            "'wt import SOURCE --to OUT.parquet'"
        )
    try:
        with pq.ParquetFile(path) as file:
            rows, width = file.metadata.num_rows, file.metadata.num_columns
            refuse_more_than_helps({path: (rows, width)})
            what = f"{rows} rows of {width} columns"
            refuse_too_much(path, 8 * rows * width, what, _COPIES_OF_WORK)
            _refuse_twice(path, file.schema_arrow.names)
            content = file.read()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RecordingError(
            f"'{path}' is not a whole Parquet file (truncated or of another format): "
            "copy it again, or give it the ending of what it is and read it with 'wt import'"
        ) from error
    if "t" not in content.column_names:
        raise RecordingError(
            f"'{path}' has no column 't' but {', '.join(content.column_names[:4])}, …: it is not a "
            "recording; make one of it with 'wt import'"
        )
    columns = {}
    for field in content.schema:
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            raise RecordingError(
                f"'{path}': column '{field.name}' holds {field.type}; a recording has float64 "
                "columns only"
            )
        # nulls become NaN, the format's missing sample
        columns[field.name] = content[field.name].cast(pa.float64(), safe=False).to_numpy()
    try:
        meta = _meta(content.schema.metadata)
    except ValueError as error:
        raise RecordingError(
            f"'{path}': its metadata (key 'wt') is not JSON in UTF-8: {error}; write it anew"
        ) from error
    return columns, meta


def refuse_too_much(path: Path, size: int, what: str = "", copies: int = _COPIES) -> None:
    """Refuse what does not fit the memory of this machine, before it is read.

    Args:
        path: the file.
        size: of its numbers when read [B].
        what: how many there are, for the message.
        copies: of them that the work keeps.

    Raises:
        RecordingError: they would not fit.
    """
    needed = copies * size
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > _SHARE_OF_MEMORY * memory:
        raise RecordingError(
            f"'{path}' has {what or f'{size / 2**30:.0f} GiB of data'}, which take about "
            f"{needed / 2**30:.0f} GiB of this machine's {memory / 2**30:.0f}; cut it, or thin it "
            "out"
        )


def refuse_more_than_helps(sizes: Mapping[str | Path, tuple[int, int]]) -> None:
    """Refuse recordings that would be worked on for minutes before a word is said.

    Args:
        sizes: rows and columns of each file that is worked on at once.

    Raises:
        RecordingError: they are; the message says by how much to cut them.
    """
    numbers = sum(rows * width for rows, width in sizes.values())
    if numbers <= _MOST:
        return
    files = ", ".join(f"'{path}'" for path in sizes)
    (rows, width), *more = sizes.values()
    have = f"{len(sizes)} files have" if more else f"{rows} rows of {width} columns are"
    raise RecordingError(
        f"{files}: {have} {numbers / 1e6:.0f} million numbers, and at most {_MOST / 1e6:.0f} "
        "million are worked on at once; cut out the telling part, or keep one row in "
        f"{-(-numbers // _MOST)} of a log that is faster than its controller"
    )


def sizes_of(paths: Iterable[str | Path]) -> dict[str | Path, tuple[int, int]]:
    """Rows and columns of each of the files that are Parquet; none of it is read."""
    sizes: dict[str | Path, tuple[int, int]] = {}
    for path in paths:
        with contextlib.suppress(pa.ArrowException, OSError, ValueError):
            metadata = pq.read_metadata(path)
            sizes[path] = metadata.num_rows, metadata.num_columns
    return sizes


def _refuse_twice(path: Path, names: Sequence[str]) -> None:
    twice = [name for i, name in enumerate(names) if name in names[:i]]
    if twice:
        raise RecordingError(f"'{path}': column '{twice[0]}' is there twice; leave one of them out")


def write(recording: Recording, path: str | Path) -> None:
    """Write one recording; an interrupted write leaves an earlier file as it was.

    Args:
        recording: what to write.
        path: where to; folders on the way are made.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, _content(recording))


def write_unless_there(recording: Recording, path: Path, option: str, source: object) -> None:
    """Write one recording where nothing is, or an earlier one of the same source.

    Args:
        recording: what to write.
        path: where to; folders on the way are made.
        option: what named the path, for messages.
        source: as for :func:`refuse_to_lose`.

    Raises:
        UserError: something else is there.
        WorkError: something else came there while this was written.
    """
    content = _content(recording)
    refuse_to_lose(path, option, source)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        write_whole(path, content)
    else:
        write_new(path, content, option)


def _content(recording: Recording) -> bytes:
    table = pa.table({"t": recording.t, **recording.columns}).replace_schema_metadata(
        {META_KEY: json.dumps(dict(recording.meta)).encode()}
    )
    content = io.BytesIO()
    pq.write_table(table, content)
    return content.getvalue()


def refuse_to_lose(path: Path, option: str, source: object, inputs: Iterable[Path] = ()) -> None:
    """Refuse to write a recording where something else stands than an earlier one like it.

    Args:
        path: where it is to go.
        option: what named the path, for the message.
        source: the recording's metadata ``source``, which an earlier one has too.
        inputs: what is read to make it.

    Raises:
        UserError: it is an input, a folder, or a file that was made otherwise.
    """
    if path.resolve() in {p.resolve() for p in inputs}:
        raise UserError(f"{option} {path} is an input too; name another file")
    if not path.exists():
        return
    try:
        earlier = _meta(pq.read_schema(path).metadata).get("source")
    except (pa.ArrowException, OSError, ValueError):
        earlier = None
    if earlier is None or earlier != source:
        raise UserError(
            f"{option} {path} is there already and was not made of {source}; name another file"
        )


def _meta(metadata: Mapping[bytes, bytes] | None) -> dict[str, object]:
    """Metadata of a file.

    Raises:
        ValueError: they are no JSON object.
    """
    try:
        meta = json.loads((metadata or {}).get(META_KEY, b"{}").decode("utf-8"))
    except RecursionError as error:
        raise ValueError("they are nested too deeply") from error
    if not isinstance(meta, dict):
        raise ValueError(f"they hold {type(meta).__name__}, not 'key: value'")
    return meta


def coordinate(channel: str) -> int | None:
    """Number of a free joint's coordinate, as in ``base/4``; None for any other channel.

    Args:
        channel: name of a column, with its group or without.
    """
    joint, _, number = channel.rpartition("/")
    return int(number) if joint not in ("", "qpos", "qvel", "ctrl") and number.isdigit() else None


def check_against(recording: Recording, model: mujoco.MjModel) -> None:
    """Check that a recording is one of this model's robot, in the model's units.

    Args:
        recording: what was recorded.
        model: the compiled MJCF it is to be compared with.

    Raises:
        RecordingError: a column names nothing in the model, no joint position was recorded, or
            a column has another unit's range (degrees); the message names the column.
    """
    check_names(recording, model)
    for joint, limit in _limits(model, "joint").items():
        _refuse_other_unit(recording, f"qpos/{joint}", limit)
    for actuator, limit in _limits(model, "actuator").items():
        _refuse_other_unit(recording, f"ctrl/{actuator}", limit)
    for i in range(model.njnt):
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE:
            _refuse_unequal_units(recording, model.joint(i).name)


def check_names(recording: Recording, model: mujoco.MjModel) -> None:
    """Check that a recording's columns are of this model's robot, in whatever units.

    Args:
        recording: what was recorded.
        model: the compiled MJCF it is to be compared with.

    Raises:
        RecordingError: a column names nothing in the model, or no joint position was recorded.
    """
    known = column_names(model)
    for name in recording.columns:
        if name not in known:
            raise RecordingError(
                f"column '{name}' names nothing in the model: {suggest(name, known)}"
            )
    if not any(name.startswith("qpos/") for name in recording.columns):
        raise RecordingError(
            "no 'qpos/<joint>' column: without a measured position there is nothing to compare"
        )


def column_names(model: mujoco.MjModel) -> set[str]:
    """The columns that a recording of a model's machine may have, but for ``t``."""
    names = set()
    for i in range(model.nu):
        names |= {f"{kind}/{model.actuator(i).name}" for kind in ("ctrl", "force")}
    for i in range(model.njnt):
        joint = model.joint(i)
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE:
            names |= {f"qpos/{joint.name}/{k}" for k in range(7)}
            names |= {f"qvel/{joint.name}/{k}" for k in range(6)}
        elif model.jnt_type[i] != mujoco.mjtJoint.mjJNT_BALL:
            names |= {f"qpos/{joint.name}", f"qvel/{joint.name}"}
    for i in range(model.nsensor):
        sensor = model.sensor(i)
        names |= {f"sensor/{sensor.name}/{k}" for k in range(model.sensor_dim[i])}
    return names


def _limits(model: mujoco.MjModel, kind: str) -> dict[str, Float[np.ndarray, "low_high=2"]]:
    """Ranges [rad] of the limited hinges, or of the position actuators that drive a hinge."""
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    if kind == "joint":
        return {
            model.joint(i).name: model.jnt_range[i]
            for i in range(model.njnt)
            if model.jnt_type[i] == hinge and model.jnt_limited[i]
        }
    limits = {}
    for i in range(model.nu):
        joint = model.actuator_trnid[i, 0]
        drives_hinge = (
            model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
            and model.jnt_type[joint] == hinge
        )
        # a position servo's force falls with the joint's position: bias -kp·q
        if drives_hinge and model.actuator_ctrllimited[i] and model.actuator_biasprm[i, 1] < 0:
            limits[model.actuator(i).name] = model.actuator_ctrlrange[i]
    return limits


def _refuse_other_unit(
    recording: Recording, column: str, limit: Float[np.ndarray, "low_high=2"]
) -> None:
    values = recording.columns.get(column)
    if values is None or not np.isfinite(values).any():
        return
    low, high = np.nanquantile(values, [0.01, 0.99])
    if low >= limit[0] - _BEYOND and high <= limit[1] + _BEYOND:
        return
    fits = low * DEGREE >= limit[0] - _BEYOND and high * DEGREE <= limit[1] + _BEYOND
    degrees = fits and max(abs(low), abs(high)) > _TURN
    what = (
        "it looks like degrees; convert it to radians, as 'wt check MODEL RECORDING --fix --out "
        "DIR' does"
        if degrees
        else "it looks like another unit or another zero, or the model's range is not the robot's"
    )
    raise RecordingError(
        f"column '{column}' runs from {low:.4g} to {high:.4g} and the model allows "
        f"{limit[0]:.4g} to {limit[1]:.4g} rad: {what}"
    )


def _refuse_unequal_units(recording: Recording, joint: str) -> None:
    """Refuse a position and a velocity of which one is in degrees and the other in radians."""
    position, velocity = (recording.columns.get(f"{kind}/{joint}") for kind in ("qpos", "qvel"))
    if position is None or velocity is None:
        return
    # central difference, on the samples between
    slope = (position[2:] - position[:-2]) / (recording.t[2:] - recording.t[:-2])
    both = np.isfinite(slope) & np.isfinite(velocity[1:-1])
    slope, velocity = slope[both], velocity[1:-1][both]
    if len(slope) < 10 or slope.std() < 1e-9 or velocity.std() < 1e-9:
        return
    if np.corrcoef(slope, velocity)[0, 1] < 0.8:
        return
    factor = velocity.std() / slope.std()
    for name, expected in ((f"qvel/{joint}", 1.0 / DEGREE), (f"qpos/{joint}", DEGREE)):
        if 0.7 < factor / expected < 1.4:
            raise RecordingError(
                f"column '{name}' looks like degrees: qvel/{joint} is {factor:.3g} times the "
                f"slope of qpos/{joint}; convert it to radians, as 'wt check MODEL RECORDING "
                "--fix --out DIR' does"
            )
