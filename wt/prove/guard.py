"""Starts a program that sees what it was handed, and neither answers, nor seeds, nor generator.

A file of the standard library alone, run by its path in a process of its own::

    python -I guard.py '{"root": …, "folder": …, "closed": […]}' MODULE ARGUMENT…

Two walls. On Linux with Landlock the kernel refuses every file outside the interpreter, the
package and the process's own folder, and everything in ``closed``; a process cannot take that
off again, nor can those that it starts. Everywhere, Python's audit hook refuses to open or list
what is in ``closed``, other processes' entries under ``/proc``, and to start other processes.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import runpy
import sys
from collections.abc import Iterator, Sequence

LANDLOCK_CREATE, LANDLOCK_ADD, LANDLOCK_RESTRICT = 444, 445, 446
"""System calls, the same on all of Linux's architectures."""
VERSION_FLAG, PATH_BENEATH = 1, 1
NO_NEW_PRIVILEGES, PARENT_DEATH_SIGNAL, SIGKILL = 38, 1, 9
EXECUTE, WRITE_FILE, READ_FILE, READ_FOLDER = 1, 1 << 1, 1 << 2, 1 << 3
RIGHTS_TO_FILES = {1: 13, 2: 14}
"""Landlock version → number of its rights to files; from the third on 15."""
NETWORK_SINCE, BIND_AND_CONNECT = 4, 3
SYSTEM = (
    "/usr", "/lib", "/lib64", "/bin", "/etc", "/opt", "/dev/null", "/dev/urandom", "/proc/self",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/sys", "/sys",
)  # fmt: skip
STARTS = ("os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty",
          "subprocess.Popen")  # fmt: skip


class Ruleset(ctypes.Structure):
    """Landlock's ``landlock_ruleset_attr``: rights that only a rule can grant."""

    _fields_ = [("files", ctypes.c_uint64), ("network", ctypes.c_uint64)]


class Beneath(ctypes.Structure):
    """Landlock's ``landlock_path_beneath_attr``."""

    _pack_ = 1
    _layout_ = "ms"
    _fields_ = [("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32)]


def main(arguments: Sequence[str]) -> None:
    """Close the walls, then run a module as a program."""
    given = json.loads(arguments[0])
    closed = [os.path.realpath(path) for path in given["closed"]]
    if sys.platform == "linux":
        # a run that is killed takes its diagnoses along
        ctypes.CDLL(None).prctl(PARENT_DEATH_SIGNAL, SIGKILL)
    wall(given["root"], given["folder"], closed)
    watch(closed)
    sys.path.insert(0, given["root"])
    sys.argv = list(arguments[1:])
    runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)


def strength() -> str:
    """``"landlock"`` where the kernel keeps the wall, ``"audit"`` where only the hook does."""
    return "landlock" if _version() else "audit"


def _version() -> int:
    """Of Landlock; 0 where there is none."""
    if sys.platform != "linux" or platform.machine() not in ("x86_64", "aarch64", "riscv64"):
        return 0
    call = ctypes.CDLL(None, use_errno=True).syscall
    return max(0, int(call(LANDLOCK_CREATE, None, 0, VERSION_FLAG)))


def wall(root: str, folder: str, closed: Sequence[str]) -> None:
    """Let the kernel refuse everything but what is listed here.

    Args:
        root: the folder that the package ``wt`` is in.
        folder: the process's own; it may do as it likes there.
        closed: files and folders that stay closed though they are in an open one.

    Raises:
        OSError: the kernel has Landlock and does not take the rules.
    """
    version = _version()
    if not version:
        return
    libc = ctypes.CDLL(None, use_errno=True)
    all_rights = (1 << RIGHTS_TO_FILES.get(version, 15)) - 1
    rules = Ruleset(all_rights, BIND_AND_CONNECT if version >= NETWORK_SINCE else 0)
    size = ctypes.sizeof(rules)
    ruleset = _checked(libc.syscall(LANDLOCK_CREATE, ctypes.byref(rules), size, 0))
    # links among them are followed: an interpreter may live anywhere
    homes = {os.path.realpath(path) for path in (sys.prefix, sys.base_prefix, *SYSTEM)}
    packages = [os.path.join(root, name) for name in ("wt", "registry")]
    readable = [inner for path in (*homes, *packages) for inner in _without(path, closed)]
    grants = [(path, READ_FILE | READ_FOLDER | EXECUTE) for path in readable]
    # names may be listed, so that packages are found; contents stay closed
    grants += [(path, READ_FOLDER) for path in (root, *homes)]
    grants += [(folder, all_rights), ("/dev/null", READ_FILE | WRITE_FILE)]
    for path, rights in grants:
        _grant(libc, ruleset, path, rights)
    _checked(libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    _checked(libc.syscall(LANDLOCK_RESTRICT, ruleset, 0))
    os.close(ruleset)


def _grant(libc: ctypes.CDLL, ruleset: int, path: str, rights: int) -> None:
    try:
        handle = os.open(path, getattr(os, "O_PATH", 0) | os.O_CLOEXEC)
    except OSError:  # not on this machine
        return
    if not os.path.isdir(path):
        rights &= READ_FILE | WRITE_FILE | EXECUTE
    beneath = Beneath(rights, handle)
    if rights:
        _checked(libc.syscall(LANDLOCK_ADD, ruleset, PATH_BENEATH, ctypes.byref(beneath), 0))
    os.close(handle)


def _without(path: str, closed: Sequence[str]) -> Iterator[str]:
    """A folder, or the largest parts of it that hold nothing closed."""
    path = os.path.realpath(path)
    if any(path == c or path.startswith(c + os.sep) for c in closed):
        return
    if not any(c.startswith(path.rstrip(os.sep) + os.sep) for c in closed):
        yield path
        return
    for name in os.listdir(path):
        yield from _without(os.path.join(path, name), closed)


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"Landlock: {os.strerror(number)}")
    return int(result)


def watch(closed: Sequence[str]) -> None:
    """Let Python refuse what is closed; a hook stays for the life of the process."""
    own = {"self", "thread-self", str(os.getpid())}

    def refused(path: object) -> bool:
        if not isinstance(path, (str, bytes, os.PathLike)):
            return False
        real = os.path.realpath(os.fsdecode(path))
        parts = real.split(os.sep)
        if parts[1:2] == ["proc"] and len(parts) > 2 and parts[2].isdigit() and parts[2] not in own:
            return True
        return any(real == c or real.startswith(c + os.sep) for c in closed)

    def hook(event: str, args: tuple[object, ...]) -> None:
        if event in STARTS:
            raise PermissionError("a diagnosis starts no other processes")
        if event in ("open", "os.listdir", "os.scandir") and args and refused(args[0]):
            raise PermissionError(13, "closed to a diagnosis", str(args[0]))

    sys.addaudithook(hook)


if __name__ == "__main__":
    main(sys.argv[1:])
