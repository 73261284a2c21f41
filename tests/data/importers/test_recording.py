"""A recording that is one already, read under a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wt.data import recording as recordings
from wt.data.importers import base
from wt.errors import RecordingError
from wt.types import Recording

T = 0.01 * np.arange(300)


def test_columns_are_exchanged_turned_and_left_out(tmp_path: Path) -> None:
    columns = {"ctrl/a": T, "qpos/a": np.sin(T), "qpos/b": np.cos(T), "force/a": T}
    path = tmp_path / "given.parquet"
    recordings.write(Recording(T, columns, {"robot": "mine", "source": "bag 7"}), path)
    mapping = {"channels": {"qpos/a": "qpos/b", "qpos/b": "qpos/a", "force/a": None},
               "signs": {"qpos/a": -1}}  # fmt: skip
    r = base.read(path, mapping)
    assert set(r.columns) == {"ctrl/a", "qpos/a", "qpos/b"}
    np.testing.assert_array_equal(r.columns["qpos/b"], np.sin(T))
    np.testing.assert_array_equal(r.columns["qpos/a"], -np.cos(T))
    assert (r.meta["robot"], r.meta["source"], r.meta["first_source"]) == (
        "mine",
        "given.parquet",
        "bag 7",
    )


def test_one_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "given.parquet"
    recordings.write(Recording(T, {"qpos/a": T}), path)
    importer = base.importers()["recording"]
    assert importer.recognises(path)
    path.write_bytes(path.read_bytes()[:-30])
    assert not importer.recognises(path)
    with pytest.raises(RecordingError, match="not a whole Parquet"):
        importer.read(path, {})
    with pytest.raises(RecordingError, match="not a whole Parquet"):
        base.read(path)
