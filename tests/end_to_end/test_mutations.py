"""Bytes that no program wrote: a reader says what is wrong in one line, whatever they are."""

from __future__ import annotations

import copy
import json
import math
import random
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import torch
from yaml import safe_load

from registry.card import CARD_FILE, Card, Golden, HeldOut, Port
from tests.data.importers.test_hdf5 import robomimic
from tests.data.importers.test_lerobot import write_dataset
from tests.data.importers.test_mcap import MAP, drives
from tests.data.importers.test_ros1 import write as write_ros1
from tests.data.importers.test_ros2 import (
    MULTI,
    STATE,
    Log,
    ms,
    multi,
    state,
    write_bag,
    write_mcap,
)
from tests.physics.ways import PLAIN
from wt.data import recording as recordings
from wt.data.guess.propose import propose
from wt.data.guess.text import text
from wt.data.importers import base
from wt.errors import UserError
from wt.physics.quiet import quiet
from wt.physics.scene import Scene
from wt.types import Channel, Recording

Reader = Callable[[Path], object]
SLOW_S = 10
"""No reader of a few kilobytes takes as long."""
WORDS = [
    b"nan", b".nan", b"inf", b"-1", b"0", b"1e400", b"99999999999999999999", b"null", b"[]", b"{}",
    b"[[[[[[[[", b'"', b"'", b"<", b">", b"&", b"&x;", b"<!DOCTYPE x>", b"\x1b[31m", b"\x00",
    b"\xff\xfe", b"\xc3", "é".encode(), b"\n", b",", b":", b"- ", b"!!python/object:os.system",
    b"&a [*a]", b"../../etc/passwd", b"t", b"qpos/a", b"ctrl/", b"true",
]  # fmt: skip


def mutated(raw: bytes, rng: random.Random) -> bytes:
    """One to three changes of some bytes."""
    data = bytearray(raw)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(data) + 1)
        end = min(len(data), at + rng.choice([1, 1, 2, 4, 8, 64]))
        kind = rng.randrange(6)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at:end] = rng.randbytes(end - at)
        elif kind == 2:
            del data[at:end]
        elif kind == 3:
            data[at:at] = data[at:end]
        elif kind == 4:
            data[at : at + rng.randrange(8)] = rng.choice(WORDS)
        elif rng.random() < 0.2:
            del data[at:]
    return bytes(data)


@contextmanager
def time_limit(what: str) -> Iterator[None]:
    def late(*_: object) -> None:
        raise TimeoutError(f"{what} takes longer than {SLOW_S} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SLOW_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def parquet(folder: Path) -> tuple[Path, Reader]:
    t, q = np.arange(0.0, 2.2, 0.02), np.sin(np.arange(110))
    meta = {"source": "x", "features": {"a": [1, 2]}}
    recordings.write(Recording(t, {"ctrl/a": q, "qpos/a": q}, meta), folder / "a.parquet")
    return folder / "a.parquet", recordings.read


CSV_MAP = "time: time\ncolumns: {ctrl/a: u, qpos/a: x, qvel/a: {column: v, scale: 2.0}}\n"
CSV_MAP += "units: {qpos/a: deg}\nsigns: {ctrl/a: -1}\noffsets: {qpos/a: 0.1}\nmeta: {robot: arm}\n"


def table(folder: Path) -> Path:
    rows = [f"{0.02 * k},{(k // 40) % 2},{(max(k - 5, 0) // 40) % 2},0.1" for k in range(110)]
    (folder / "log.csv").write_text("time,u,x,v\n" + "\n".join(rows) + "\n")
    return folder / "log.csv"


def csv(folder: Path) -> tuple[Path, Reader]:
    mapping = {"time": "time", "columns": {"ctrl/a": "u", "qpos/a": "x"}}
    return table(folder), lambda path: base.doubts(base.read(path, mapping))


def yaml(folder: Path) -> tuple[Path, Reader]:
    source = table(folder)
    (folder / "map.yaml").write_text(CSV_MAP)
    return folder / "map.yaml", lambda path: base.read(source, base.read_map(path))


def bag_log() -> Log:
    log: Log = []
    for k in range(50):
        message = state(ms(50 * k), position=[0.1 * k, 0.2], velocity=[2.0, 0.0], effort=[0.5, 0.1])
        log.append(("/joint_states", STATE, ms(50 * k + 3), message))
        log.append(("/arm/commands", MULTI, ms(50 * k + 4), multi(float(k), 1.0)))
    return log


def mcap(folder: Path) -> tuple[Path, Reader]:
    return write_mcap(folder / "a.mcap", bag_log()), base.read


def protobuf(folder: Path) -> tuple[Path, Reader]:
    return drives(folder / "a.mcap"), lambda path: base.read(path, MAP)


def ros1(folder: Path) -> tuple[Path, Reader]:
    return write_ros1(folder / "a.bag"), base.read


def hdf5(folder: Path) -> tuple[Path, Reader]:
    path = robomimic(folder / "a.h5", 1, control_freq=20)
    return path, lambda path: base.read(path, {"time": {"rate": 20}})


ARRAYS = {"t": np.arange(0.0, 2.2, 0.02), "qpos/a": np.sin(np.arange(110.0))}


def npz(folder: Path) -> tuple[Path, Reader]:
    np.savez(folder / "a.npz", **ARRAYS)
    return folder / "a.npz", base.read


def npy(folder: Path) -> tuple[Path, Reader]:
    np.save(folder / "a.npy", np.stack(list(ARRAYS.values()), axis=1))
    mapping = {"time": {"rate": 20}, "columns": {"qpos/a": {"array": "data", "index": 1}}}
    return folder / "a.npy", lambda path: base.read(path, mapping)


def matlab(folder: Path) -> tuple[Path, Reader]:
    scipy.io.savemat(folder / "a.mat", {"t": ARRAYS["t"], "q": ARRAYS["qpos/a"]})
    return folder / "a.mat", lambda path: base.read(path, {"columns": {"qpos/a": "q"}})


def tensors(folder: Path) -> tuple[Path, Reader]:
    torch.save({name: torch.tensor(x) for name, x in ARRAYS.items()}, folder / "a.pt")
    return folder / "a.pt", base.read


def guessed(folder: Path) -> tuple[Path, Reader]:
    return table(folder), lambda path: text(propose(path), path)


def db3(folder: Path) -> tuple[Path, Reader]:
    bag = write_bag(folder / "bag", bag_log())
    return next(bag.glob("*.db3")), base.read


def mjcf(folder: Path) -> tuple[Path, Reader]:
    (folder / "arm.xml").write_text(PLAIN)
    return folder / "arm.xml", Scene


def card(folder: Path) -> tuple[Path, Reader]:
    ports = [Port(n, ("batch", 1), (Channel("q", "rad"),)) for n in ("o", "a", "o_next_sim")]
    row = ((0.5,),)
    Card(
        name="wt-r5", task="toy", rate_hz=50.0, joints=("hip",), inputs=tuple(ports),
        outputs=(Port("o_next_real", ("batch", 1), (Channel("q", "rad"),)),), data_hash="a",
        config_hash="b", commit="c", metrics={"mse": 0.1}, parity=1e-7, sha256=64 * "0",
        heldout=HeldOut("pairs/test", "a", "mse", 0.1), golden=Golden(row, row, row, row),
        created="2026-11-25T00:00:00+00:00", packages={"python": "3.11"},
    ).save(folder)  # fmt: skip
    return folder / CARD_FILE, lambda path: Card.load(path.parent)


def lerobot(folder: Path) -> tuple[Path, Reader]:
    episode = write_dataset(folder) / "data" / "chunk-000" / "episode_000001.parquet"
    return folder / "meta" / "info.json", lambda path: base.read(episode)


READERS = {
    "parquet": (parquet, 400),
    "csv": (csv, 200),
    "map": (yaml, 200),
    "mcap": (mcap, 150),
    "db3": (db3, 150),
    "protobuf": (protobuf, 40),
    "ros1": (ros1, 60),
    "hdf5": (hdf5, 100),
    "npz": (npz, 100),
    "npy": (npy, 100),
    "matlab": (matlab, 100),
    "tensors": (tensors, 60),
    "guessed": (guessed, 40),
    "mjcf": (mjcf, 400),
    "card": (card, 300),
}


def refusals(read: Reader, path: Path, kind: str, contents: Iterable[bytes]) -> int:
    """Number of contents that are refused, as they should be if at all."""
    refused = 0
    for k, content in enumerate(contents):
        path.write_bytes(content)
        with time_limit(f"{kind} {k}"), quiet():
            try:
                read(path)
            except UserError as error:
                refused += 1
                assert str(error).strip(), k
            except Exception as error:
                raise AssertionError(f"{kind} {k}: {error!r}") from error
    return refused


@pytest.mark.parametrize("kind", READERS)
def test_whatever_the_bytes_only_a_line_comes_out(kind: str, tmp_path: Path) -> None:
    make, count = READERS[kind]
    path, read = make(tmp_path)
    read(path)
    raw, rngs = path.read_bytes(), [random.Random(f"{kind} {k}") for k in range(count)]
    assert refusals(read, path, kind, [mutated(raw, rng) for rng in rngs]) > count // 20


ODD = [5, -1, 1e300, math.nan, math.inf, None, True, "", "é", "qpos/a", [], [1], {}, {"a": 1}, [[]]]


def odd(tree: object, rng: random.Random) -> object:
    """A tree of maps and lists with another value at one place."""
    if isinstance(tree, (dict, list)) and tree and rng.random() < 0.8:
        keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
        key = rng.choice(keys)
        changed = copy.copy(tree)
        changed[key] = odd(tree[key], rng)
        return changed
    return rng.choice(ODD)


@pytest.mark.parametrize("kind", ["map", "lerobot", "card"])
def test_whatever_stands_at_a_place_only_a_line_comes_out(kind: str, tmp_path: Path) -> None:
    path, read = {"map": yaml, "lerobot": lerobot, "card": card}[kind](tmp_path)
    read(path)
    tree = safe_load(path.read_text())
    trees = [odd(tree, random.Random(f"{kind} {k}")) for k in range(120)]
    assert refusals(read, path, kind, [json.dumps(t).encode() for t in trees]) > 12
