"""A passport's folder only grows, and notices what was changed in it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.passport.passports import DAYS, addition, estimates
from wt.errors import DataError, WorkError
from wt.passport.folder import append, locked, read


def test_additions_come_back_and_earlier_files_stay_as_they_are(tmp_path: Path) -> None:
    first, second = estimates(range(3)), estimates(range(3, len(DAYS)))
    with locked(tmp_path):
        append(tmp_path, addition(first))
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with locked(tmp_path):
        append(tmp_path, addition(second))
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    assert len(list(tmp_path.iterdir())) == 4
    found = read(tmp_path)
    assert set(found.rows) == {*first, *second}
    assert found.units == ("A17", "B04", "C21")
    assert len(found.sources) == 3 * len(DAYS)
    (planted,) = found.hypothesis
    assert planted.key == ("joint.friction_coulomb", "joint", "elbow")
    np.testing.assert_array_equal(planted.theta, [0.2])


def test_estimates_are_one_row_a_group_and_parameter(tmp_path: Path) -> None:
    rows = estimates()
    with locked(tmp_path):
        table, _ = append(tmp_path, addition(rows))
    content = pq.read_table(table)
    assert content.num_rows == len(rows)
    assert {"unit", "session", "load", "effect", "place", "parameter", "value", "error"} <= set(
        content.column_names
    )


def test_the_latest_estimate_of_a_group_counts(tmp_path: Path) -> None:
    old, new = estimates(seed=1), estimates(seed=2)
    for rows in (old, new):
        with locked(tmp_path):
            append(tmp_path, addition(rows))
    assert set(read(tmp_path).rows) == set(new)


def test_nothing_there_is_an_empty_passport(tmp_path: Path) -> None:
    assert read(tmp_path / "none").additions == ()
    (tmp_path / "notes.json").write_text("{}")
    (tmp_path / "mine.parquet").write_bytes(b"")
    assert read(tmp_path).additions == ()
    with locked(tmp_path):
        append(tmp_path, addition(estimates()))
    assert len(read(tmp_path).additions) == 1
    assert (tmp_path / "notes.json").read_text() == "{}"


@pytest.mark.parametrize("suffix", ["json", "parquet"])
def test_what_was_changed_is_noticed(tmp_path: Path, suffix: str) -> None:
    with locked(tmp_path):
        append(tmp_path, addition(estimates()))
    (path,) = tmp_path.glob(f"*.{suffix}")
    path.write_bytes(path.read_bytes().replace(b"B04", b"B05"))
    with pytest.raises(DataError, match="changed"):
        read(tmp_path)


def test_what_is_missing_is_noticed(tmp_path: Path) -> None:
    for sessions in (range(2), range(2, 4)):
        with locked(tmp_path):
            append(tmp_path, addition(estimates(sessions)))
    next(tmp_path.glob("0001-*.json")).unlink()
    with pytest.raises(DataError, match="follows an addition that is not there"):
        read(tmp_path)


def test_an_interrupted_addition_is_none(tmp_path: Path) -> None:
    """Its Parquet file is there, its JSON file is not: it is not read, and not written over."""
    with locked(tmp_path):
        _, said = append(tmp_path, addition(estimates(range(2))))
    said.unlink()
    (left,) = tmp_path.iterdir()
    content = left.read_bytes()
    assert read(tmp_path).additions == ()
    with locked(tmp_path):
        table, _ = append(tmp_path, addition(estimates(range(2))))
    assert table != left
    assert left.read_bytes() == content
    assert len(read(tmp_path).additions) == 1


def test_two_at_once_are_kept_apart(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(WorkError, match="another wt process"), locked(tmp_path):
        pass


def test_the_json_is_of_a_stated_schema(tmp_path: Path) -> None:
    with locked(tmp_path):
        _, said = append(tmp_path, addition(estimates(range(1))))
    content = json.loads(said.read_text())
    assert content["schema"] == 1
    assert content["before"] is None
    assert content["recordings"][0] == {
        "path": "/logs/A17-2026-11-01.parquet", "sha256": "A172026-11-01",
        "unit": "A17", "session": "2026-11-01", "load": "none",
    }  # fmt: skip
