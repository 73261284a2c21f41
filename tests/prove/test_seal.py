"""Seals open with their own key and name only, and commit to what is inside."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from wt.errors import DataError
from wt.prove.seal import new_key, read_key, seal, unseal

ANSWER = {"truth": [{"effect": "joint.friction_coulomb", "parameters": {"coulomb": 0.5}}]}


def test_a_seal_opens_with_its_key() -> None:
    key = new_key()
    sealed, committed = seal(ANSWER, "case-1", key)
    answer, salt = unseal(sealed, "case-1", key, committed)
    assert answer == ANSWER
    # the commitment can be checked without us
    text = json.dumps(ANSWER, sort_keys=True, separators=(",", ":"))
    assert hashlib.sha256(bytes.fromhex(salt) + text.encode()).hexdigest() == committed


def test_bytes_say_nothing() -> None:
    key = new_key()
    something, first = seal(ANSWER, "case-1", key)
    nothing, _ = seal({"truth": []}, "case-1", key)
    again, second = seal(ANSWER, "case-1", key)
    assert len(something) == len(nothing)
    assert b"friction" not in something
    assert something != again
    assert first != second  # salted: equal answers cannot be told


@pytest.mark.parametrize("what", ["key", "name", "bytes", "commitment"])
def test_anything_else_does_not_open_it(what: str) -> None:
    key = new_key()
    sealed, committed = seal(ANSWER, "case-1", key)
    changed = bytearray(sealed)
    changed[-1] ^= 1
    arguments = {
        "key": (sealed, "case-1", new_key(), committed),
        "name": (sealed, "case-2", key, committed),
        "bytes": (bytes(changed), "case-1", key, committed),
        "commitment": (sealed, "case-1", key, "0" * 64),
    }[what]
    with pytest.raises(DataError, match=r"case-[12]"):
        unseal(*arguments)


def test_keys_are_files_or_digits(tmp_path: Path) -> None:
    key, file = new_key(), tmp_path / "cases.key"
    file.write_text(key.hex() + "\n")
    assert read_key(str(file)) == read_key(key.hex()) == key
    file.write_text("no key")
    for wrong in (str(file), "abcd", str(tmp_path / "missing")):
        with pytest.raises(DataError, match="64 hexadecimal digits"):
            read_key(wrong)
