"""Entry point of ``wt``: finds the commands, runs one, turns what goes wrong into one line.

Exit codes: 0 done, 1 the work failed, 2 wrong arguments or bad input.
"""

from __future__ import annotations

import errno
import importlib
import inspect
import os
import pkgutil
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated

import typer

import wt
import wt.cli
from wt.cli import _extras, _warnings
from wt.errors import WTError

QUIET = {
    "DO_NOT_TRACK": "true",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "ORT_DISABLE_TELEMETRY": "1",
    "RAY_USAGE_STATS_ENABLED": "0",
}
"""Switches of the libraries' telemetry. Only entry points may set them, never an import."""

_HELP = """When a simulator and a robot disagree, find what is missing, or translate between them.

Every command has --help with an example. Exit codes: 0 done, 1 the work failed, 2 bad input.
With WT_DEBUG=1 in the environment, an error shows its traceback. The tab key completes commands and
options after wt --install-completion."""

_DISK_FULL = re.compile(
    r"disk is full|No space left on device|\d requested and \d+ written|unexpected pos \d+ vs \d"
)
"""Messages of libraries without an errno: SQLite, those in Rust, numpy's save, torch's save."""

_SECTION = re.compile(r"^(Args|Returns|Yields|Raises|Attributes|Note|Example):\s*$", re.MULTILINE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; never lets a traceback through.

    Args:
        argv: the arguments after ``wt``; None for those of this process.
    """
    return _run(build, "wt", argv)


def single(command: Callable[..., object], name: str, argv: Sequence[str] | None = None) -> int:
    """Run a command that is a program of its own, as :func:`main` does those of ``wt``.

    Args:
        command: as in a module of ``wt.cli``.
        name: of the program.
        argv: its arguments; None for those of this process.
    """
    text, example = _split_doc(command)

    def one() -> typer.Typer:
        app = typer.Typer(rich_markup_mode=None)
        app.command(help=text, epilog=example)(command)
        return app

    return _run(one, name, argv)


def _run(make: Callable[[], typer.Typer], name: str, argv: Sequence[str] | None) -> int:
    os.environ.update(QUIET)
    try:
        program = typer.main.get_command(make())
        _offer_version(program)
        with _warnings.no_log(), _warnings.one_line_each(_warn):
            code = program.main(
                args=None if argv is None else list(argv), prog_name=name, standalone_mode=False
            )
    except Exception as error:
        if os.environ.get("WT_DEBUG", "0") not in ("", "0"):
            raise
        message, exit_code = explain(error)
        return _fail(message, exit_code)
    except KeyboardInterrupt:
        code = 130
    if code == 130:  # how typer reports Ctrl-C, which it catches itself
        return _fail("interrupted: nothing finished is lost; run the same command again", 1)
    return code if isinstance(code, int) else 0


def build() -> typer.Typer:
    """The application, with every command module of ``wt.cli`` found and added.

    Raises:
        AttributeError: a module of ``wt.cli`` offers neither ``command`` nor ``app``.
    """
    # Plain help: rich's panels would triple the start-up and read "[key=value]" as markup.
    app = typer.Typer(rich_markup_mode=None)
    app.callback(help=_HELP, epilog="Example: wt fit --config debug")(_root)
    for file in pkgutil.iter_modules(wt.cli.__path__):
        if file.name == "main" or file.name.startswith("_"):
            continue
        module = importlib.import_module(f"wt.cli.{file.name}")
        name = file.name.rstrip("_").replace("_", "-")
        if hasattr(module, "command"):
            text, example = _split_doc(module.command)
            kind = getattr(module, "Command", None)
            app.command(name, cls=kind, help=text, epilog=example)(module.command)
        elif hasattr(module, "app"):
            app.add_typer(_with_examples(module.app), name=name)
        else:
            raise AttributeError(
                f"{module.__file__} offers neither a function 'command' nor a typer 'app'; "
                "a helper's name starts with an underscore"
            )
    return app


def explain(error: Exception) -> tuple[str, int]:
    """One line that says what went wrong and what to do, and the exit code.

    Args:
        error: what ended the command.
    """
    if isinstance(error, WTError):
        return str(error), error.exit_code
    if isinstance(error, typer.TyperException):  # wrong arguments
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "wt"
        return f"{error.format_message()} (see: {command} --help)", error.exit_code
    if isinstance(error, ModuleNotFoundError) and (line := _extras.missing(error.name)):
        return line, 1
    if any(_disk_full(e) for e in _chain(error)):
        return (
            "the disk is full; earlier outputs are intact: free some space, then run again "
            f"({error})",
            1,
        )
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror, 1
    kind = type(error).__name__
    return f"unexpected {kind}: {error} (WT_DEBUG=1 in the environment shows the traceback)", 1


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _disk_full(error: BaseException) -> bool:
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return True
    return bool(_DISK_FULL.search(str(error)))


def _fail(message: str, exit_code: int) -> int:
    print(f"error: {printable(' '.join(message.split()))}", file=sys.stderr)
    return exit_code


def _warn(text: str) -> None:
    print(f"warning: {printable(text)}", file=sys.stderr)


def printable(text: str) -> str:
    """A text whose control characters are spelt out: names of users' files may hold any."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _offer_version(command: typer._click.Command) -> None:
    """Give a command, and those in it, the option ``--version`` of :func:`_root`."""
    options = typer.Typer(add_completion=False)
    options.command()(_root)
    (version,) = (p for p in typer.main.get_command(options).params if p.name == "version")
    version.expose_value = False  # no function but _root takes it
    waiting = [command]
    while waiting:
        one = waiting.pop()
        waiting += getattr(one, "commands", {}).values()
        if all(p.name != "version" for p in one.params):
            one.params.append(version)


def _print_version(wanted: bool) -> bool:
    if wanted:
        print(f"wt {wt.__version__}")
        raise typer.Exit
    return wanted


def _root(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print it.", callback=_print_version, is_eager=True),
    ] = False,
) -> None:
    """Options of ``wt`` itself."""


def _split_doc(function: Callable[..., object] | None) -> tuple[str, str]:
    """Help and epilog of a command, taken from its docstring's text and ``Example:`` section."""
    parts = _SECTION.split(inspect.getdoc(function) or "")
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    # "\b" keeps typer from joining the lines of a paragraph.
    example = inspect.cleandoc(sections.get("Example", ""))
    return parts[0].strip(), f"\b\nExample:\n{example}" if example else ""


def _with_examples(group: typer.Typer) -> typer.Typer:
    group.rich_markup_mode = None
    for info in group.registered_commands:
        text, example = _split_doc(info.callback)
        info.help, info.epilog = info.help or text, info.epilog or example
    return group


if __name__ == "__main__":
    sys.exit(main())
