"""Transitions that stay on disk: their row groups are theirs, in order, and no others are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.data.test_transitions import IDENTITY, SHARDS, SPEC, each, get, toy, toy_pairs
from wt.data import transitions as disk
from wt.data.stored import Stored
from wt.data.transitions import Shard, ensure, obtain
from wt.errors import DataError
from wt.types import Transitions


@pytest.fixture
def stored(tmp_path: Path) -> Stored:
    """10, 10 and 5 transitions in three shards of one row group each."""
    home = ensure(tmp_path, IDENTITY, SPEC, SHARDS, each(toy))
    return Stored.of([home / shard.file for shard in SHARDS], SPEC)


def observations(*parts: Transitions) -> np.ndarray:
    return np.concatenate([part.o for part in parts])


WHOLE = observations(*map(toy, SHARDS))


def test_its_row_groups_are_the_collection(stored: Stored) -> None:
    assert (len(stored), stored.largest) == (25, 10)
    np.testing.assert_array_equal(observations(*map(stored.read, range(3))), WHOLE)


def test_large_shards_are_divided(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk, "ROW_GROUP", 4)
    home = ensure(tmp_path, IDENTITY, SPEC, SHARDS, each(toy))
    stored = Stored.of([home / shard.file for shard in SHARDS], SPEC)
    assert [group.rows for group in stored.groups] == [4, 4, 2, 4, 4, 2, 4, 1]
    np.testing.assert_array_equal(stored.read(4).o, WHOLE[14:18])
    np.testing.assert_array_equal(stored.read(4).step, toy(SHARDS[1]).step[4:8])
    # who reads the shards whole notices nothing
    whole = obtain(tmp_path, IDENTITY, SPEC, SHARDS, each(toy))
    np.testing.assert_array_equal(whole.o, WHOLE)
    np.testing.assert_array_equal(np.unique(whole.episode), np.arange(8))


@pytest.mark.parametrize(
    ("most", "rows"),
    [(25, [*range(10), *range(10, 20)]), (20, [*range(20)]), (19, [*range(10)]), (3, [0, 1, 2])],
)
def test_a_sample_is_as_many_row_groups_as_fit(stored: Stored, most: int, rows: list[int]) -> None:
    np.testing.assert_array_equal(stored.sample(most).o, WHOLE[rows])


def test_a_sample_is_spread_over_the_collection(tmp_path: Path) -> None:
    shards = [Shard(f"part-{k:03d}.parquet", k, 4) for k in range(9)]
    home = ensure(tmp_path, IDENTITY, SPEC, shards, each(toy))
    sample = Stored.of([home / shard.file for shard in shards], SPEC).sample(12)
    np.testing.assert_array_equal(sample.o, observations(*(toy(shards[k]) for k in (0, 3, 6))))
    # an episode of one row group is not continued in another
    np.testing.assert_array_equal(sample.episode, np.repeat(np.arange(3), 4))


@pytest.mark.parametrize("rows", [0, 3, 5, 7, 15, 20])
def test_the_last_transitions_and_all_others(stored: Stored, rows: int) -> None:
    others = stored.without_last(rows)
    assert len(others) == 25 - rows
    kept = observations(*(others.read(k) for k in range(len(others.groups))))
    np.testing.assert_array_equal(kept, WHOLE[: 25 - rows])
    last = stored.last(rows).o if rows else WHOLE[25:]
    assert len(last) in {0, 5, 15, 25} and len(last) >= rows
    np.testing.assert_array_equal(last, WHOLE[25 - len(last) :])


def test_a_truncated_shard_is_noticed_before_anything_is_read(stored: Stored) -> None:
    part = stored.groups[1].path
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(DataError, match=f"{part.name} cannot be read .* delete it") as caught:
        Stored.of([group.path for group in stored.groups], SPEC)
    assert "\n" not in str(caught.value)


def test_a_damaged_row_group_is_noticed_when_it_is_read(stored: Stored) -> None:
    part = stored.groups[0].path
    whole = part.read_bytes()
    part.write_bytes(whole[:300] + bytes([whole[300] ^ 0x10]) + whole[301:])
    with pytest.raises(DataError, match=f"{part.name} cannot be read"):
        stored.read(0)
    stored.read(1)


def test_pairs_do_not_pass_for_transitions(tmp_path: Path) -> None:
    get(tmp_path, toy_pairs)
    (part, *_) = sorted(tmp_path.glob("*/part-*.parquet"))
    with pytest.raises(DataError, match="where transitions belong"):
        Stored.of([part], SPEC).read(0)
