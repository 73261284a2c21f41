"""Joints and actuators of a model behind the names of a log."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco

from wt.data.guess.words import core

_SIMILAR = 0.75


@dataclass
class Names:
    """What the log's names are in the model.

    Attributes:
        joints: log's joint → the model's, where it has one.
        commands: log's joint → the model's actuator, where it has one.
        doubts: of what was guessed.
    """

    joints: dict[str, str] = field(default_factory=dict)
    commands: dict[str, str] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)


def match(joints: Sequence[str], commands: Sequence[str], model: mujoco.MjModel) -> Names:
    """Find a log's names in a model.

    Args:
        joints: names of what was measured.
        commands: names of what was commanded.
        model: with a name for every element.
    """
    scalar = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    known = [model.joint(i).name for i in range(model.njnt) if int(model.jnt_type[i]) in scalar]
    found = Names()
    found.joints = _matched(list(joints), known, "joint", found.doubts)
    actuators = [model.actuator(i).name for i in range(model.nu)]
    driver = _drivers(model)
    by_joint = {name: driver[joint] for name, joint in found.joints.items() if joint in driver}
    found.commands = {name: by_joint[name] for name in commands if name in by_joint}
    for name in (n for n in commands if n not in found.commands):
        undriven = [j for j, a in driver.items() if a not in found.commands.values()]
        joint = _equal(name, undriven) or _ending(name, undriven)
        if joint is not None and _equal(name, actuators) is None:
            found.commands[name] = driver[joint]
    rest = [name for name in commands if name not in found.commands]
    free = [name for name in actuators if name not in found.commands.values()]
    if rest:
        found.commands |= _matched(rest, free, "actuator", found.doubts)
    return found


def _drivers(model: mujoco.MjModel) -> dict[str, str]:
    """Joint → the one actuator that drives it."""
    joints = [
        model.joint(model.actuator_trnid[i, 0]).name
        for i in range(model.nu)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
    ]
    names = [
        model.actuator(i).name
        for i in range(model.nu)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
    ]
    return {j: a for j, a in zip(joints, names, strict=True) if joints.count(j) == 1}


def _matched(names: list[str], known: list[str], what: str, doubts: list[str]) -> dict[str, str]:
    """Names → known ones: equal words, then one's words at the other's end, likeness, order."""
    matched = _counted_from_zero(names, known)
    if matched:
        first, to = next(iter(matched.items()))
        doubts.append(
            f"the log counts from 0 and the model's {what}s from 1: {first} is taken for {to}, and "
            "so on"
        )
    for rule in (_equal, _ending, _alike):
        for name in names:
            left = [k for k in known if k not in matched.values()]
            if name not in matched and (fit := rule(name, left)) is not None:
                matched[name] = fit
                if rule is _alike:
                    doubts.append(f"{name!r} is taken for the model's {what} {fit!r}, by its looks")
    rest = [name for name in names if name not in matched]
    left = [k for k in known if k not in matched.values()]
    if rest and len(rest) == len(left) and all(_number(name) is not None for name in rest):
        in_order = sorted(rest, key=lambda name: _number(name) or 0)
        matched |= dict(zip(in_order, left, strict=True))
        doubts.append(
            f"the {what}s {_some(in_order)} are taken in the model's order ({_some(left)}): see "
            "that it is the log's"
        )
    elif rest:
        doubts.append(f"{_some(rest)}: no {what} of the model is called so; it has {_some(left)}")
    return matched


def _counted_from_zero(names: list[str], known: list[str]) -> dict[str, str]:
    """Bare numbers from 0 on → known ones with numbers from 1 on; {} where both begin alike."""
    count = {number: name for name in names if (number := _number(name)) is not None}
    series: dict[tuple[str, ...], dict[int, str]] = {}
    for name in known:
        if len(digits := _digits(name)) == 1:
            words = tuple(word for word in core(name) if not word.isdigit())
            series.setdefault(words, {})[int(digits[0])] = name
    fit = [s for s in series.values() if 0 not in s and {n + 1 for n in count} <= set(s)]
    return {count[n]: fit[0][n + 1] for n in sorted(count)} if 0 in count and len(fit) == 1 else {}


def _some(names: list[str]) -> str:
    return ", ".join(names[:6]) + (", …" if len(names) > 6 else "") or "no other"


def _equal(name: str, known: list[str]) -> str | None:
    if name in known:
        return name
    same = [k for k in known if core(k) == core(name) and core(name)]
    return same[0] if len(same) == 1 else None


def _ending(name: str, known: list[str]) -> str | None:
    mine = core(name)
    ends = []
    for k in known:
        theirs = core(k)
        n = min(len(mine), len(theirs))
        if n and (mine[-n:] == theirs[-n:] or mine[:n] == theirs[:n]):
            ends.append(k)
    return ends[0] if len(ends) == 1 else None


def _alike(name: str, known: list[str]) -> str | None:
    by_core = {"_".join(core(k)): k for k in known}
    near = difflib.get_close_matches("_".join(core(name)), by_core, n=1, cutoff=_SIMILAR)
    # numbers that differ are other joints, however alike the rest is
    if near and _digits(near[0]) == _digits(name):
        return by_core[near[0]]
    return None


def _digits(name: str) -> list[str]:
    return [word for word in core(name) if word.isdigit()]


def _number(name: str) -> int | None:
    """The number of a name that is nothing else."""
    said = core(name)
    return int(said[0]) if len(said) == 1 and said[0].isdigit() else None
