"""Write files so that each is the earlier one or the whole new one, and nobody else's is lost."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path

from wt.errors import UserError, WorkError

try:
    import fcntl
except ImportError:  # not on Windows, where nothing keeps two processes apart
    fcntl = None  # type: ignore[assignment]

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
_TAKEN = (errno.EWOULDBLOCK, errno.EACCES)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write to a temporary name beside ``path`` and rename it when whole.

    Raises:
        OSError: the disk is full or the folder cannot be written; an earlier file is intact.
    """
    write_together(path.parent, {path.name: content})


def write_new(path: Path, content: bytes, option: str) -> None:
    """The same where nothing is yet, even if another process writes there at the same time.

    Args:
        path: the file.
        content: what to write.
        option: what named it, for messages.

    Raises:
        WorkError: something is there by now; it is left as it is.
        OSError: the disk is full or the folder cannot be written.
    """
    part = _part(path)
    try:
        _write(part, content)
        try:
            os.link(part, path)
        except FileExistsError as error:
            raise WorkError(
                f"{option} {path} was written by another process meanwhile; name another file"
            ) from error
        except OSError:  # a file system without links
            os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def write_together(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write several files into a folder; the first is renamed when the last is whole.

    Temporary names are new ones: nobody else's file is written to, and no link is followed.

    Args:
        folder: where they go; it exists.
        contents: what to write, by file name.

    Raises:
        OSError: the disk is full or the folder cannot be written; earlier files are intact.
    """
    parts: dict[str, Path] = {}
    try:
        for name, content in contents.items():
            parts[name] = _part(folder / name)
            _write(parts[name], content)
        for name, part_path in parts.items():
            os.replace(part_path, folder / name)
    finally:
        for part_path in parts.values():
            part_path.unlink(missing_ok=True)


def _part(path: Path) -> Path:
    """A temporary name beside a file's that nobody else has."""
    return path.with_name(f".{path.name}.{secrets.token_hex(6)}.part")


def _write(part: Path, content: str | bytes) -> None:
    with os.fdopen(os.open(part, _NEW, 0o666), "wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def kept(folder: Path, option: str = "--out") -> Iterator[None]:
    """Make a folder, see that it can be written into, and keep other processes out of it.

    What was made and is still empty at the end is removed.

    Args:
        folder: the folder.
        option: what named it, for messages.

    Raises:
        UserError: it is a file, or cannot be made or written into.
        WorkError: another process writes into it.
    """
    made = _made(folder, option)
    try:
        with _locked(folder, option):
            yield
    finally:
        for new in made:
            with contextlib.suppress(OSError):
                new.rmdir()


def refuse_unwritable(folder: Path, option: str) -> None:
    """See that files can be written into a folder, before there are any; nothing is left of it.

    Args:
        folder: the folder; it need not be there.
        option: what named it, or a file in it, for messages.

    Raises:
        UserError: it is a file, or cannot be made or written into.
        OSError: the disk is full.
    """
    for new in _made(folder, option):
        new.rmdir()


def _made(folder: Path, option: str) -> list[Path]:
    """The folders that had to be made, the innermost first."""
    new = list[Path]()
    try:
        if folder.exists() and not folder.is_dir():
            raise UserError(f"{option} {folder} is a file; name a folder")
        new = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{secrets.token_hex(6)}.part"
        os.close(os.open(probe, _NEW, 0o666))
        probe.unlink()
    except OSError as error:
        for path in new:
            with contextlib.suppress(OSError):
                path.rmdir()
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise UserError(
            f"{option} {folder} cannot be written ({error.strerror}); name another folder"
        ) from error
    return new


@contextlib.contextmanager
def _locked(folder: Path, option: str) -> Iterator[None]:
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in _TAKEN:
                raise WorkError(
                    f"{option} {folder} is being written by another wt process; wait for its end "
                    "or name another folder"
                ) from error
            # a file system without locks
        yield
    finally:
        os.close(handle)  # and the lock goes with it
