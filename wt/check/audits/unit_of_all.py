"""Positions and commands of a servo that share another unit, so that they agree with each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np

from wt.check.audit import Stage, Subject, register
from wt.check.balance import Balance, Edit
from wt.check.finding import AuditFinding
from wt.check.velocity import belongs
from wt.physics.scene import Drive, Scene
from wt.types import Recording

_BEYOND = 0.5  # rad past a limit: more than any offset or compliance explains
_SWEEP = 3.0 * math.pi  # rad that a limb without limits may sweep
_PERCENT = 100.5
_TICKS = 4096
_ALIKE = 0.5  # of the mean logarithm of what is left: units that say as much
_FACTORS = np.geomspace(1e-4, 0.5, 16)


@register
class UnitOfAll:
    """Hinges far outside of what the model allows, and inside it in another unit."""

    kinds: ClassVar[tuple[str, ...]] = ("unit_of_all",)
    stage: ClassVar[Stage] = "column"

    def findings(self, subject: Subject) -> Iterable[AuditFinding]:
        """At most one: the unit of all joints of the kind together."""
        scene, recording = subject.scene, subject.recording
        if scene is None or recording is None:
            return
        strange = [d for d in scene.drives if d.servo and _strange(scene, recording, d)]
        if not strange or subject.balance is None:
            return
        found = _unit(scene, recording, subject.balance, strange)
        if found is None:
            return
        unit, edits = found
        columns = _columns(scene, recording, edits)
        worst = strange[0].joint
        x = recording.columns[f"qpos/{worst}"]
        yield AuditFinding(
            "unit_of_all",
            tuple(columns),
            tuple(f"joint {d.joint}" for d in strange),
            f"'qpos/{worst}' runs from {np.nanmin(x):.4g} to {np.nanmax(x):.4g}, far outside of "
            f"what a hinge of the model does, and so does its command: these columns are {unit}",
            _map(unit, columns, whole=len(edits) == 2 * len(_all_hinges(scene, recording))),
            change=lambda r: replace(
                r,
                columns={
                    **r.columns,
                    **{n: r.columns[n] * f + o for n, (f, o) in columns.items()},
                },
            ),
        )


def _unit(
    scene: Scene, recording: Recording, balance: Balance, strange: Sequence[Drive]
) -> tuple[str, tuple[Edit, ...]] | None:
    """The unit after which the weight is explained, of all hinges or of the strange ones alone.

    None where the model explains as much of the forces without: then its limits are wrong.
    """
    drives = _all_hinges(scene, recording)
    named = _options(scene, recording, drives)
    if not balance.dynamic or not balance.rows:
        return next(iter(named.items())) if 2 * len(strange) > len(drives) else None
    options = list(named.items())
    if len(strange) < len(drives):
        options += _options(scene, recording, strange).items()
    best = min(options, key=lambda option: balance.misfit(option[1]))
    factor = _fitted(balance, strange)
    fitted = _scaled(strange, factor)
    if balance.misfit(fitted) < balance.misfit(best[1]) - _ALIKE:
        best = (f"some {1.0 / factor:.3g} times the model's", fitted)
    return best if balance.misfit(best[1]) < balance.misfit() - _ALIKE else None


def _fitted(balance: Balance, drives: Sequence[Drive]) -> float:
    """Factor common to positions and commands after which most of the forces is explained."""
    factor = 1.0
    for grid in (_FACTORS, np.geomspace(0.75, 1.35, 9), np.geomspace(0.95, 1.05, 9)):
        trials = factor * grid
        misfits = [balance.misfit(_scaled(drives, float(trial))) for trial in trials]
        factor = float(trials[int(np.argmin(misfits))])
    return factor


def _strange(scene: Scene, recording: Recording, drive: Drive) -> bool:
    """Tell whether position and command of a hinge are where only another unit takes them."""
    m = scene.model
    joint = int(m.joint(drive.joint).id)
    position = recording.columns.get(f"qpos/{drive.joint}")
    command = recording.columns.get(f"ctrl/{drive.name}")
    if position is None or command is None or m.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        return False
    held = drive.held_per_command * command
    both = [x[np.isfinite(x)] for x in (position, held)]
    if min(len(x) for x in both) < 12 or min(np.ptp(x) for x in both) < 1e-6:
        return False
    if m.jnt_limited[joint]:
        low, high = m.jnt_range[joint]
        return all(
            np.quantile(x, 0.01) < low - _BEYOND or np.quantile(x, 0.99) > high + _BEYOND
            for x in both
        )
    return all(np.ptp(x) > _SWEEP for x in both)


def _all_hinges(scene: Scene, recording: Recording) -> list[Drive]:
    """Servos on hinges whose position and command are about equal, as tracking makes them."""
    chosen = []
    for drive in scene.drives:
        joint = int(scene.model.joint(drive.joint).id)
        pair = [recording.columns.get(n) for n in (f"qpos/{drive.joint}", f"ctrl/{drive.name}")]
        if (
            drive.servo
            and scene.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
            and all(x is not None and np.isfinite(x).sum() > 12 for x in pair)
        ):
            chosen.append(drive)
    return chosen


def _options(
    scene: Scene, recording: Recording, drives: Sequence[Drive]
) -> dict[str, tuple[Edit, ...]]:
    """What would undo each unit; empty where it cannot be of that unit."""
    values = np.concatenate(
        [
            recording.columns[n][np.isfinite(recording.columns[n])]
            for d in drives
            for n in (f"qpos/{d.joint}",)
        ]
    )
    if np.array_equal(values, np.round(values)) and np.abs(values).max() > 400.0:
        middle = 0.0 if values.min() < 0.0 else _TICKS / 2
        turn = 2.0 * math.pi / _TICKS
        return {f"in ticks of {_TICKS} a turn": _edits(drives, lambda d: (turn, -middle * turn))}
    options = {"in degrees": _scaled(drives, math.pi / 180.0)}
    limits = {d.name: _limits(scene, d) for d in drives}
    if np.abs(values).max() <= _PERCENT and all(limits.values()):

        def of_range(d: Drive) -> tuple[float, float]:
            low, high = limits[d.name] or (0.0, 0.0)
            return (high - low) / 200.0, 0.5 * (low + high)

        percent = {"in percent of the range, −100…100": _edits(drives, of_range)}
        fits = all(_inside(scene, recording, d, math.pi / 180.0) for d in drives)
        options = {**options, **percent} if fits else {**percent, **options}
    return options


def _edits(drives: Sequence[Drive], of: Callable[[Drive], tuple[float, float]]) -> tuple[Edit, ...]:
    listed = []
    for d in drives:
        factor, offset = of(d)
        listed.append(Edit("q", d.dof, d.dof, factor, offset))
        listed.append(Edit("u", d.index, d.index, factor, offset))
    return tuple(listed)


def _scaled(drives: Sequence[Drive], factor: float) -> tuple[Edit, ...]:
    return _edits(drives, lambda _: (factor, 0.0))


def _limits(scene: Scene, drive: Drive) -> tuple[float, float] | None:
    m = scene.model
    joint = int(m.joint(drive.joint).id)
    return (
        (float(m.jnt_range[joint, 0]), float(m.jnt_range[joint, 1]))
        if (m.jnt_limited[joint])
        else None
    )


def _inside(scene: Scene, recording: Recording, drive: Drive, factor: float) -> bool:
    limits, x = _limits(scene, drive), recording.columns[f"qpos/{drive.joint}"]
    return limits is None or bool(
        np.nanquantile(x, 0.01) * factor > limits[0] - 0.2
        and np.nanquantile(x, 0.99) * factor < limits[1] + 0.2
    )


def _columns(
    scene: Scene, recording: Recording, edits: Sequence[Edit]
) -> dict[str, tuple[float, float]]:
    """(factor, offset) of every column that is of the unit."""
    columns = {}
    for e in edits:
        if e.group == "u":
            columns[f"ctrl/{scene.model.actuator(e.index).name}"] = (e.factor, e.offset)
            continue
        joint = scene.joints[e.index]
        columns[f"qpos/{joint}"] = (e.factor, e.offset)
        if f"qvel/{joint}" in recording.columns and belongs(recording, joint):
            columns[f"qvel/{joint}"] = (e.factor, 0.0)
    return columns


def _map(unit: str, columns: dict[str, tuple[float, float]], whole: bool) -> str:
    """The entry of a map; ``whole`` if the columns are all that can be in degrees."""
    degrees = unit == "in degrees"
    if degrees and whole:
        return "units: deg"
    factors = ", ".join(f"{n}: {'deg' if degrees else f'{f:.5g}'}" for n, (f, _) in columns.items())
    offsets = ", ".join(f"{n}: {o:.4g}" for n, (_, o) in columns.items() if abs(o) > 1e-9)
    return f"units: {{{factors}}}" + (f"; offsets: {{{offsets}}}" if offsets else "")
