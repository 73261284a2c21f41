"""What libraries warn of is one line each, said once; MuJoCo's log stays out of users' folders."""

from __future__ import annotations

import importlib.util
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TextIO


@contextmanager
def one_line_each(say: Callable[[str], None]) -> Iterator[None]:
    """Hand every warning's text to ``say``, once, without the line of code that it came from.

    Args:
        say: shows a line.
    """
    said = set[str]()

    def show(
        message: Warning | str, category: type[Warning], filename: str, lineno: int,
        file: TextIO | None = None, line: str | None = None,
    ) -> None:  # fmt: skip
        text = " ".join(str(message).split())
        if not any(text in line for line in said):
            said.add(text)
            say(text)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


@contextmanager
def no_log() -> Iterator[None]:
    """Have MuJoCo write no ``MUJOCO_LOG.TXT`` into the folder where this process runs.

    MuJoCo is not imported for that: it would make every ``--help`` wait.
    """
    if "mujoco" in sys.modules:
        before = _write_log(sys.modules["mujoco"], False)
    else:
        before = True
        sys.meta_path.insert(0, _Import())
    try:
        yield
    finally:
        sys.meta_path[:] = [f for f in sys.meta_path if not isinstance(f, _Import)]
        if "mujoco" in sys.modules:
            _write_log(sys.modules["mujoco"], before)


def _write_log(mujoco: ModuleType, on: bool) -> bool:
    """Switch MuJoCo's log file on or off; gives what it was."""
    config = mujoco.MjLogConfig.get()
    before, config.logto_file = bool(config.logto_file), on
    config.set()
    return before


class _Import(MetaPathFinder):
    """Finds MuJoCo as usual, once, and switches its log off as soon as it is loaded."""

    def find_spec(
        self, fullname: str, path: object, target: ModuleType | None = None
    ) -> ModuleSpec | None:  # the path of a namespace package is no sequence
        if fullname != "mujoco":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_without_log(module: ModuleType) -> None:
                load(module)
                _write_log(module, False)

            spec.loader.exec_module = load_without_log  # type: ignore[method-assign]
        return spec
