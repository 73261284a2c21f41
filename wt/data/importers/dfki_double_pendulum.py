"""Runs of the torque-controlled double pendulum: a trajectory.csv with one column a quantity.

Joint 1 becomes ``shoulder``, joint 2 ``elbow``; angles are from hanging down, the second relative
to the first, as in :func:`wt.worlds.rigs.double_pendulum_spec`. The command is ``tau_con``, the
torque that was sent to the motor [N·m]: the laboratory's controller adds its friction
compensation to it before it logs (AbstractController.get_control_output), so ``tau_fric`` is a part
of it and must not be added again; it is zero in all published runs of design C.1. The measured
force is ``tau_meas``, from the motor current. Filtered copies and plans are left out.

No keys of a map beyond those that every format has.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from wt.data.importers import _csv
from wt.data.importers.base import Map, register
from wt.errors import DataError
from wt.types import Recording

JOINTS = ("shoulder", "elbow")
_FILE = "trajectory.csv"
_KINDS = {"ctrl": "tau_con", "qpos": "pos_meas", "qvel": "vel_meas", "force": "tau_meas"}


@register
class DfkiDoublePendulum:
    """Reads one run."""

    name: ClassVar[str] = "dfki_double_pendulum"
    about: ClassVar[str] = f"a {_FILE} with tau_con1 and pos_meas1, or its folder"
    keys: ClassVar[frozenset[str]] = frozenset()
    general: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """True if ``path`` is such a file, or the folder of one."""
        path = path / _FILE if path.is_dir() else path
        if path.suffix != ".csv" or not path.is_file():
            return False
        with path.open("rb") as file:
            header = file.readline(4096)
        return b"tau_con1" in header and b"pos_meas1" in header

    def read(self, path: Path, mapping: Map) -> Recording:
        """The run as a recording; see the module for what is what.

        Raises:
            DataError: a column is missing or holds something else than numbers.
        """
        source = path / _FILE if path.is_dir() else path
        table = _csv.read(source)
        try:
            columns = {
                f"{kind}/{joint}": _csv.numbers(table[f"{foreign}{i + 1}"])
                for i, joint in enumerate(JOINTS)
                for kind, foreign in _KINDS.items()
            }
            t = _csv.numbers(table["time"])
        except KeyError as error:
            raise DataError(f"'{source}' has no column {error}") from error
        if not all(np.isfinite(values).all() for values in (t, *columns.values())):
            raise DataError(f"'{source}' is not a table of numbers (cut off or edited?)")
        run = source.resolve().parent.name if source.name == _FILE else source.name
        meta = {"robot": "DFKI double pendulum C.1", "source": run, "format": self.name}
        return Recording(t, columns, meta)
