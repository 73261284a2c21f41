"""Columns of a learned law as lines of ``physics.py``, step by step as in replays."""

from __future__ import annotations

from collections.abc import Sequence

from wt.diagnose.unknown.memory import Memory, memory_of
from wt.physics.script import Helper, number


def column_lines(names: Sequence[str]) -> tuple[list[str], tuple[Helper, ...]]:
    """Lines that put the column ``names[i]`` of n simulations into ``x<i>``, and what they call."""
    lines: list[str] = []
    helpers: dict[Helper, None] = {}
    for i, name in enumerate(names):
        memory = memory_of(name)
        kind, _, place = name.partition("/")
        if memory is not None:
            lines += _remembered(memory, i)
            helpers |= {"creep" if memory.kind == "creep" else "swing": None}
        elif kind in ("qpos", "qvel"):
            pair = f"x{i}, _" if kind == "qpos" else f"_, x{i}"
            lines.append(f'{pair}, _ = self._joint("{place}", qpos, qvel)')
        elif kind == "ctrl":
            index = f'self.model.actuator("{place}").id'
            lines.append(f"x{i} = ctrl[:, self.model.actuator_ctrladr[{index}]]")
        elif kind == "force":
            lines.append(f'x{i}, _ = self._drive("{place}", qpos, qvel, ctrl)')
            helpers |= {"drive": None}
        else:
            lines.append(f"x{i} = t")
    return lines, tuple(helpers)


def _remembered(memory: Memory, i: int) -> list[str]:
    lines = [f'q, v, _ = self._joint("{memory.joint}", qpos, qvel)']
    name, rate = f'"{memory.kind} {memory.joint} {i}"', number(memory.rate)
    if memory.kind == "creep":
        return [*lines, f"x{i} = self._creep({name}, v, {rate}, h)"]
    pair = f"x{i}, _" if memory.kind == "swing" else f"_, x{i}"
    return [*lines, f"{pair} = self._swing({name}, q, v, {rate}, {number(memory.damping)}, h)"]
