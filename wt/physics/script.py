"""What an effect is in ``physics.py``: plain lines of numpy for what MJCF cannot say.

The lines of all effects are put together by :mod:`wt.mjcf.physics`, each under its statement, into
the methods of one class that needs numpy and MuJoCo alone. They see these names:

========= =========================================================================================
``self``  ``model``; ``recording``, the index of the recording whose events act; and the helpers
          that are asked for, see :data:`wt.mjcf.physics.HELPERS`
``f``     generalised forces of n simulations, (n, nv) [N·m or N]: to be added to
``qpos``, ``qvel``, ``ctrl``, ``t``  their states, commands as the drives receive them, and times,
          (n, nq), (n, nv), (n, nu), (n,)
          an effect that moves a drive's command binds ``ctrl`` anew, and later ones see that
``h``     physics step [s]
``t``, ``q``, ``v``  in ``sense`` and ``undo``: times (time,), and the joints' positions and
          velocities, (time, joint); ``joint("j1")`` is the column of a joint
``data``  in ``start``: of the one simulation that begins
========= =========================================================================================

Hidden states are arrays (n,) with a name: ``self._state(name, begin)`` is now, and what is put into
``self._next[name]`` is one step later.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Literal

WIDTH = 88
"""Of a line, which is indented by two levels more in the file."""
Helper = Literal[
    "joint", "drive", "drives", "given", "bristle", "push", "residual", "creep", "swing", "gear",
    "command", "profile",
]  # fmt: skip


@dataclass(frozen=True)
class Script:
    """Lines of Python, without indentation.

    Attributes:
        force: add to the generalised forces.
        sense: turn true positions and velocities into what sensors report, in place.
        undo: the reverse of ``sense``, as far as there is one, in place.
        start: put joints that the patch added in balance with those of ``data``.
        helpers: what the lines call.
    """

    force: tuple[str, ...] = ()
    sense: tuple[str, ...] = ()
    undo: tuple[str, ...] = ()
    start: tuple[str, ...] = ()
    helpers: tuple[Helper, ...] = ()

    @property
    def acts(self) -> bool:
        """Whether MJCF alone lacks something; a start is only a state."""
        return bool(self.force or self.sense)


def wrapped(line: str) -> list[str]:
    """A long line that may be broken at its spaces, as lines of the same indentation."""
    indent = " " * (len(line) - len(line.lstrip()))
    return textwrap.wrap(line, WIDTH, subsequent_indent=indent) if line else [line]


def number(value: float) -> str:
    """A figure with ten digits: more say nothing about a robot."""
    return f"{value:.10g}"
