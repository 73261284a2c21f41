"""``wt studio``: check, mapping, diagnosis and report on one page of this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    folder: Annotated[
        Path | None,
        typer.Option("--dir", help="Folder of the session.  [default: studio-<time>]"),
    ] = None,
    limit_mb: Annotated[int, typer.Option(min=1, help="Largest file that may be dropped.")] = 512,
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="To listen on.  [default: a free one]")
    ] = None,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Serve a page on which models and logs are checked, mapped and diagnosed.

    Prints its address, which only this machine reaches and which holds a token: whoever has not
    seen it gets nothing. Nothing leaves the machine, and the page loads nothing from elsewhere.
    All that it does lies in --dir, and the page prints the commands that do the same. Ctrl-C ends
    it; with the same --dir a session goes on.

    Example:
        wt studio
        wt studio --dir arm --open
    """
    import webbrowser

    from wt.show.files import kept
    from wt.studio.serve import bound, serve
    from wt.studio.session import Session
    from wt.studio.uploads import MB

    listening = bound(port)
    session = Session(folder)

    def ready(address: str) -> None:
        typer.echo(address)
        typer.echo(f"The session is in {session.folder}; Ctrl-C ends it.", err=True)
        if show:
            webbrowser.open(address)

    with kept(session.folder, "--dir"):  # from a second studio
        serve(session, limit_mb * MB, listening, ready)
