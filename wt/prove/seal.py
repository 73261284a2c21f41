"""Seals: an answer is committed to and encrypted before anybody looks for it.

A seal is AES-256-GCM over a JSON of the answer and a salt, padded so that its length says nothing,
and bound to the case's name. The commitment, the salted SHA-256 of the answer, is published with
the cases: whoever holds answer and salt later can check that nothing was changed.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from wt.errors import DataError

_NONCE, _SALT, _BLOCK = 12, 32, 4096


def new_key() -> bytes:
    """A fresh key, 32 bytes."""
    return AESGCM.generate_key(256)


def read_key(given: str) -> bytes:
    """A key from a file or from its 64 hexadecimal digits.

    Raises:
        DataError: it is neither.
    """
    path = Path(given)
    text = path.read_text().strip() if len(given) < 4096 and path.is_file() else given
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if len(key) != 32:
        what = "holds no key" if path.is_file() else "is no file and no key"
        raise DataError(f"--key: '{given[:80]}' {what}; a key is 64 hexadecimal digits")
    return key


def commitment(answer: Mapping[str, Any], salt: str) -> str:
    """SHA-256 of salt and answer, in hexadecimal; keys sorted, no spaces, UTF-8."""
    return hashlib.sha256(bytes.fromhex(salt) + _canonical(answer)).hexdigest()


def seal(answer: Mapping[str, Any], name: str, key: bytes) -> tuple[bytes, str]:
    """Encrypt an answer.

    Args:
        answer: JSON of it.
        name: the case's; the seal opens under no other.
        key: 32 bytes.

    Returns:
        The sealed bytes and the commitment.
    """
    salt = secrets.token_hex(_SALT)
    text = _canonical({"salt": salt, "answer": answer})
    text += b" " * (-len(text) % _BLOCK)
    nonce = secrets.token_bytes(_NONCE)
    return nonce + AESGCM(key).encrypt(nonce, text, name.encode()), commitment(answer, salt)


def unseal(sealed: bytes, name: str, key: bytes, committed: str) -> tuple[dict[str, Any], str]:
    """Open a seal.

    Args:
        sealed: what :func:`seal` made.
        name: the case's.
        key: the one it was sealed with.
        committed: the commitment that was published.

    Returns:
        The answer and its salt.

    Raises:
        DataError: another key, changed bytes, or another answer than was committed to.
    """
    try:
        text = AESGCM(key).decrypt(sealed[:_NONCE], sealed[_NONCE:], name.encode())
    except (InvalidTag, ValueError) as error:
        raise DataError(
            f"the seal of case '{name}' does not open: the key is another one, or the file was "
            "changed; use the key that the answers were sealed with"
        ) from error
    inside = json.loads(text)
    if commitment(inside["answer"], inside["salt"]) != committed:
        raise DataError(
            f"the answer of case '{name}' is not the one that was committed to; "
            "ask for the manifest that belongs to the seals"
        )
    return inside["answer"], inside["salt"]


def sha256(path: Path) -> str:
    """Of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _canonical(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
