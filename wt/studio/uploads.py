"""Files from the page into the session's folder: under plain names, up to a limit, whole or not."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import stat
import zipfile
from collections.abc import AsyncIterator
from pathlib import Path, PurePosixPath

from wt.errors import UserError
from wt.studio.session import LOGS, MODEL, MODELS

MB = 2**20
ASSETS = (*MODELS, ".stl", ".obj", ".msh", ".ply", ".png", ".jpg", ".jpeg", ".dae", ".skn", ".ktx")
"""Endings of a model and of what it may refer to; everything else is a log."""
_DEEPEST, _LONGEST = 8, 120
_MOST_FILES = 5000
_ODD = re.compile(r"[\x00-\x1f\x7f<>:\"|?*\\]")


def plain(name: str) -> PurePosixPath:
    """A relative path of a dropped file, safe to use below a folder.

    Raises:
        UserError: it leads out of the folder, or a part of it is no plain file name.
    """
    parts = name.split("/")
    for part in parts:
        if part in ("", ".", "..") or part.startswith(".") or _ODD.search(part):
            raise UserError(
                f"{name[:_LONGEST]!r} is no plain file name; rename it: no '..', no leading dot or "
                'slash, no control characters or any of < > : " | ? * \\'
            )
        if len(part.encode()) > _LONGEST:
            raise UserError(f"the name {part[:30]!r}… is too long; at most {_LONGEST} bytes")
    if len(parts) > _DEEPEST:
        raise UserError(f"{name[:_LONGEST]!r} lies too deep; at most {_DEEPEST} folders")
    return PurePosixPath(name)


def place(name: str) -> PurePosixPath:
    """Where a dropped file goes in the session's folder: to the model, or to the logs.

    Raises:
        UserError: as :func:`plain`.
    """
    path = plain(name)
    return PurePosixPath(MODEL if path.suffix.lower() in ASSETS else LOGS) / path


async def receive(chunks: AsyncIterator[bytes], target: Path, limit: int) -> None:
    """Write a stream to a new file; what is there already stays as it is.

    Args:
        chunks: the content.
        target: the file; folders on the way are made.
        limit: at most so many bytes.

    Raises:
        UserError: it is there already, or too large; nothing is left of it.
    """
    _refuse_there(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(f".{secrets.token_hex(6)}.part")
    size = 0
    try:
        with part.open("xb") as file:
            async for chunk in chunks:
                size += len(chunk)
                if size > limit:
                    raise UserError(too_large(target.name, limit))
                file.write(chunk)
        _refuse_there(target)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


def too_large(name: str, limit: int) -> str:
    """The line about an upload over the limit."""
    return (
        f"'{name}' is larger than {limit / MB:.4g} MB; cut it, or start wt studio with a higher "
        "--limit-mb"
    )


def unpack(archive: Path, folder: Path, limit: int) -> list[str]:
    """Unpack a .zip: to the model if there is a model in it, else to the logs, under its own name.

    Args:
        archive: the file, which goes when all of it is unpacked.
        folder: of the session.
        limit: at most so many bytes come out.

    Returns:
        What came out, relative to the folder.

    Raises:
        UserError: it is broken, too large, or leads out of the folder; nothing is left of it.
    """
    try:
        with zipfile.ZipFile(archive) as file:
            entries = [e for e in file.infolist() if not e.is_dir() and not _of_a_mac(e.filename)]
            _refuse_bomb(archive.name, entries, limit)
            names = [plain(e.filename) for e in entries]
            model = any(n.suffix.lower() in MODELS for n in names)
            top = folder / MODEL if model else folder / LOGS / archive.stem
            part = archive.with_name(f".{secrets.token_hex(6)}.part")
            try:
                _extract(file, entries, part, limit)
                return [p.relative_to(folder).as_posix() for p in _moved(part, names, top)]
            finally:
                shutil.rmtree(part, ignore_errors=True)
    except (zipfile.BadZipFile, RuntimeError, OSError, EOFError) as error:
        raise UserError(f"'{archive.name}' cannot be unpacked: {error}; pack it again") from error
    finally:
        archive.unlink(missing_ok=True)


def _of_a_mac(name: str) -> bool:
    """Tell whether macOS added this beside the file that was packed."""
    return name.startswith("__MACOSX/") or name.rpartition("/")[2] == ".DS_Store"


def _refuse_bomb(name: str, entries: list[zipfile.ZipInfo], limit: int) -> None:
    if len(entries) > _MOST_FILES:
        raise UserError(f"'{name}' holds {len(entries)} files; at most {_MOST_FILES}")
    if sum(e.file_size for e in entries) > limit:
        raise UserError(too_large(name, limit))
    for entry in entries:
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise UserError(f"'{name}' holds a link, {entry.filename!r}; pack the file itself")


def _extract(file: zipfile.ZipFile, entries: list[zipfile.ZipInfo], part: Path, limit: int) -> None:
    """Unpack under numbers; sizes are counted, for what an archive says of itself may be false."""
    part.mkdir()
    left = limit
    for number, entry in enumerate(entries):
        with file.open(entry) as source, (part / str(number)).open("xb") as target:
            while chunk := source.read(MB):
                left -= len(chunk)
                if left < 0:
                    raise UserError(too_large(str(file.filename), limit))
                target.write(chunk)


def _moved(part: Path, names: list[PurePosixPath], top: Path) -> list[Path]:
    targets = [top / name for name in names]
    for target in targets:
        _refuse_there(target)
    for number, target in enumerate(targets):
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(part / str(number), target)
    return targets


def _refuse_there(target: Path) -> None:
    if target.exists():
        raise UserError(f"'{target.name}' is there already; remove that one first, or rename this")
