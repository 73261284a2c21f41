"""The command line: one module a command, each of which parses, calls and prints.

How to add a command
====================

Write ``wt/cli/<name>.py``; it is found by itself (:func:`wt.cli.main.build`). The command's name
is the module's, ``_`` read as ``-`` and a trailing ``_`` dropped (``import_.py`` is ``wt import``).
The module has one of two names:

``command``
    A function with Typer's annotations, for a single command (``wt fit``).
``app``
    A ``typer.Typer(help=…)`` with several, for a group (``wt registry list``).

Beside ``command``, a ``Command`` (a ``TyperCommand``) may read the arguments in its own way.

A module with neither is refused, so that no command is forgotten silently; helpers that several
commands share start with an underscore (``_progress.py``).

The docstring of a command is its ``--help``: everything up to the first Google section (``Args:``,
``Raises:``) stands above the options, and the section ``Example:``, which every command needs, ends
the help::

    def command(
        config: Annotated[Path, typer.Option(help="YAML file of the task.")],
        overrides: Annotated[list[str] | None, typer.Argument(metavar="[KEY=VALUE]...")] = None,
    ) -> None:
        # Its docstring: a summary, then "Example:" and, indented, the command line.
        from wt.train import fit  # heavy: inside the function, never at the top of the module

What a command need not do: catch errors. It raises :class:`wt.errors.UserError` (exit code 2) or
:class:`wt.errors.WorkError` (exit code 1), and ``main`` prints the one line. Tables and results go
to stdout, progress bars to stderr and only where that is a terminal. At import a command module
loads nothing heavier than numpy: ``tests/architecture/test_startup.py`` holds it.
"""
