"""Collections on disk: written once, read again, continued, and never half there."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wt.data import transitions as disk
from wt.data.transitions import Make, Shard, content_hash, digest, obtain, plan
from wt.errors import DataError
from wt.types import Channel, Pairs, Transitions, TransitionSpec

Q, V, LAST = Channel("qpos/j", "rad"), Channel("qvel/j", "rad/s"), Channel("last_action/j", "rad")
SPEC = TransitionSpec(
    task="toy", rate_hz=50.0, joints=("j",), observation=(Q, V, LAST), n_state=2,
    action=(Channel("ctrl/j", "rad"),), hidden=(Channel("force/x", "N"),), pose=(0,),
)  # fmt: skip
IDENTITY: dict[str, Any] = {"what": "real", "options": {"gain": 2.0}}
SHARDS = plan(25, seed=7, shard=10)


def toy(shard: Shard) -> Transitions:
    """Random transitions in episodes of four steps; the seed decides them."""
    rng, n = np.random.default_rng(shard.seed), shard.count
    return Transitions(
        o=rng.standard_normal((n, 3)),
        a=rng.standard_normal((n, 1)),
        s_next=rng.standard_normal((n, 2)),
        nominal=rng.standard_normal((n, 2)),
        hidden=np.where(rng.uniform(size=(n, 1)) < 0.3, np.nan, 1.0),
        episode=np.arange(n) // 4,
        step=np.arange(n) % 4,
    )


def toy_pairs(shard: Shard) -> Pairs:
    real = toy(shard)
    return Pairs(real, real.s_next + 1)


class Counting:
    """A maker that counts, and that fails at one part."""

    def __init__(self, fail_at: str = "") -> None:
        self.made: list[str] = []
        self.fail_at = fail_at

    def __call__(self, shard: Shard) -> Transitions:
        if shard.file == self.fail_at:
            raise KeyboardInterrupt
        self.made.append(shard.file)
        return toy(shard)


def each(make: Callable[[Shard], Transitions | Pairs]) -> Make:
    """Makes one shard after the other."""
    return lambda shards: ((shard, make(shard)) for shard in shards)


def get(
    folder: Path,
    make: Callable[[Shard], Transitions | Pairs] = toy,
    identity: dict[str, Any] = IDENTITY,
    spec: TransitionSpec = SPEC,
) -> Transitions | Pairs:
    return obtain(folder, identity, spec, SHARDS, each(make))


def parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/part-*.parquet"))


def test_plan_covers_the_count_with_seeds_of_their_own() -> None:
    assert [s.count for s in SHARDS] == [10, 10, 5]
    assert len({s.seed for s in SHARDS}) == 3
    assert [s.file for s in SHARDS] == sorted({s.file for s in SHARDS})
    assert plan(25, seed=7, shard=10) == SHARDS
    assert not {s.seed for s in plan(25, seed=8, shard=10)} & {s.seed for s in SHARDS}
    assert [s.count for s in plan(20, seed=0, shard=10)] == [10, 10]


def test_what_was_made_is_what_comes_back(tmp_path: Path) -> None:
    made = [toy(s) for s in SHARDS]
    back = get(tmp_path)
    assert isinstance(back, Transitions)
    for name in ("o", "a", "s_next", "nominal", "hidden", "step"):
        np.testing.assert_array_equal(
            getattr(back, name), np.concatenate([getattr(m, name) for m in made])
        )
    # episodes go on: 3 of the first part, 3 of the second, 2 of the third
    np.testing.assert_array_equal(np.unique(back.episode), np.arange(8))
    assert back.episode[10] == 3
    assert (np.diff(back.episode) >= 0).all()


def test_pairs_come_back_as_pairs(tmp_path: Path) -> None:
    back = get(tmp_path, toy_pairs)
    assert isinstance(back, Pairs)
    np.testing.assert_allclose(back.sim_next, back.real.s_next + 1)


def test_made_once(tmp_path: Path) -> None:
    maker = Counting()
    first = get(tmp_path, maker)
    assert maker.made == [s.file for s in SHARDS]
    second = get(tmp_path, maker)
    assert len(maker.made) == 3
    assert content_hash(first) == content_hash(second)


def test_interrupted_goes_on_where_it_stopped(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        get(tmp_path, Counting(fail_at=SHARDS[1].file))
    assert [p.name for p in parts(tmp_path)] == [SHARDS[0].file]
    rest = Counting()
    resumed = get(tmp_path, rest)
    assert rest.made == [s.file for s in SHARDS[1:]]
    assert content_hash(resumed) == content_hash(get(tmp_path / "elsewhere"))


@pytest.mark.parametrize(
    "other",
    [{"what": "real", "options": {"gain": 2.5}}, {"what": "sim", "options": {"gain": 2.0}}],
)
def test_another_option_is_another_collection(tmp_path: Path, other: dict[str, Any]) -> None:
    maker = Counting()
    get(tmp_path, maker)
    get(tmp_path, maker, identity=other)
    assert len(maker.made) == 6
    assert len(list(tmp_path.iterdir())) == 2


def test_manifest_says_what_it_is(tmp_path: Path) -> None:
    get(tmp_path)
    (home,) = tmp_path.iterdir()
    manifest = json.loads((home / "manifest.json").read_text())
    assert manifest["options"] == {"gain": 2.0}
    assert manifest["shards"] == [[s.file, s.seed, s.count] for s in SHARDS]
    assert manifest["rate_hz"] == 50.0
    assert manifest["units"] == {
        "o/qpos/j": "rad", "o/qvel/j": "rad/s", "o/last_action/j": "rad", "a/ctrl/j": "rad",
        "s_next/qpos/j": "rad", "s_next/qvel/j": "rad/s", "h/force/x": "N",
    }  # fmt: skip
    # the folder's name ends in the hash of what decides the content, by the standard library
    decides = {k: manifest[k] for k in ("format", "what", "options", "shards")}
    sha = hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()[:16]
    assert manifest["hash"] == sha
    assert home.name == f"toy-real-{sha}"


def test_columns_are_named_for_others_to_read(tmp_path: Path) -> None:
    get(tmp_path)
    table = pq.read_table(parts(tmp_path)[0])
    np.testing.assert_array_equal(table["s_next/qvel/j"].to_numpy(), toy(SHARDS[0]).s_next[:, 1])
    assert {"o/last_action/j", "a/ctrl/j", "nominal/qpos/j", "h/force/x", "episode", "step"} <= set(
        table.column_names
    )
    assert table.schema.field("o/qpos/j").type == pa.float32()


@pytest.mark.parametrize("keep", [0, 3, 200, 0.5])
def test_truncated_part(tmp_path: Path, keep: float) -> None:
    get(tmp_path)
    part = parts(tmp_path)[1]
    whole = part.read_bytes()
    part.write_bytes(whole[: int(keep * len(whole)) if keep < 1 else int(keep)])
    with pytest.raises(DataError, match=f"{part.name} cannot be read") as caught:
        get(tmp_path)
    assert "\n" not in str(caught.value)
    assert "delete it" in str(caught.value)
    part.unlink()
    again = Counting()
    get(tmp_path, again)
    assert again.made == [part.name]


def test_one_damaged_byte_is_noticed_or_changes_nothing(tmp_path: Path) -> None:
    whole_hash = content_hash(get(tmp_path))
    part = parts(tmp_path)[0]
    whole = part.read_bytes()
    noticed = 0
    for at in range(4, len(whole), 97):
        part.write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
        try:
            assert content_hash(get(tmp_path)) == whole_hash, at
        except DataError as error:
            noticed += 1
            assert part.name in str(error)
            assert "\n" not in str(error)
    assert noticed > 10


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("o/qvel/j", None, "no column 'o/qvel/j'"),
        ("episode", None, "no column 'episode'"),
        ("h/force/x", None, "no column 'h/force/x'"),
        ("a/ctrl/j", ["far"] * 10, "far"),
        ("s_next/qpos/j", [float("nan")] * 10, "'s_next' is not finite at row 0"),
    ],
)
def test_foreign_part(tmp_path: Path, column: str, values: list[Any] | None, message: str) -> None:
    get(tmp_path)
    part = parts(tmp_path)[0]
    table = pq.read_table(part)
    at = table.column_names.index(column)
    foreign = table.remove_column(at)
    if values is not None:
        foreign = foreign.add_column(at, column, pa.array(values))
    pq.write_table(foreign, part)
    with pytest.raises(DataError, match=message) as caught:
        get(tmp_path)
    assert str(part) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_full_disk_leaves_no_half_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyboardInterrupt):
        get(tmp_path, Counting(fail_at=SHARDS[1].file))
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def full(table: pa.Table, where: Path, **_: object) -> None:
        Path(where).write_bytes(b"PAR1 half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(where))

    with monkeypatch.context() as m:
        m.setattr(disk.pq, "write_table", full)
        with pytest.raises(OSError, match="No space left") as caught:
            get(tmp_path)
    assert caught.value.errno == errno.ENOSPC
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    rest = Counting()
    get(tmp_path, rest)
    assert rest.made == [s.file for s in SHARDS[1:]]


def test_full_disk_at_the_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: bytes) -> None:
        path.open("wb").write(content[:5])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as m:
        m.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match="No space left"):
            get(tmp_path)
    (home,) = tmp_path.iterdir()
    assert sorted(p.name for p in home.iterdir()) == [s.file for s in SHARDS]
    maker = Counting()
    get(tmp_path, maker)
    assert maker.made == []
    assert json.loads((home / "manifest.json").read_text())["format"] == 1


def test_a_whole_collection_is_only_read(tmp_path: Path) -> None:
    get(tmp_path)
    before = {p: (p.stat().st_ino, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")}
    get(tmp_path)
    assert {p: (p.stat().st_ino, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")} == before


def test_two_processes_may_collect_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = pq.write_table

    def overtaken(table: pa.Table, where: Path, **options: bool | str) -> None:
        write(table, where, **options)
        with monkeypatch.context() as rival:
            rival.setattr(disk.pq, "write_table", write)
            rival.setattr(os, "getpid", lambda: 1)
            get(tmp_path)

    monkeypatch.setattr(disk.pq, "write_table", overtaken)
    both = get(tmp_path)
    assert content_hash(both) == content_hash(get(tmp_path))
    (home,) = tmp_path.iterdir()
    assert {p.name for p in home.iterdir()} == {*(s.file for s in SHARDS), "manifest.json"}


def test_digest_does_not_depend_on_order_or_container() -> None:
    assert digest({"a": 1, "b": (1.0, 2.0)}) == digest({"b": [1.0, 2.0], "a": 1})
    assert digest({"a": 1}) != digest({"a": 2})
    assert len(digest("x")) == 16


def test_content_hash_sees_every_value() -> None:
    data = toy(SHARDS[0])
    assert content_hash(data) == content_hash(toy(SHARDS[0]))
    assert content_hash(Pairs(data, data.s_next)) == content_hash(data)
    some, rest = data.select(np.arange(4)), data.select(np.arange(4, len(data)))
    assert content_hash([some, rest]) == content_hash(data), "however it is divided"
    for name in ("o", "a", "s_next"):
        changed = {f: np.array(getattr(data, f)) for f in data.__dataclass_fields__}
        changed[name][3, 0] += 1e-3
        assert content_hash(Transitions(**changed)) != content_hash(data)
