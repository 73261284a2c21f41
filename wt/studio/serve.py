"""The server: on the loopback alone, below a token that nobody can guess."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import socket
from collections.abc import Callable

import uvicorn

from wt.errors import UserError, WorkError
from wt.studio.app import make
from wt.studio.guard import Guard
from wt.studio.jobs import Jobs
from wt.studio.session import Session

ADDRESS, PORT = "127.0.0.1", 8745


def serve(
    session: Session, limit: int, listening: socket.socket, ready: Callable[[str], None]
) -> None:
    """Serve the page until Ctrl-C.

    Args:
        session: its folder.
        limit: size of an upload [bytes].
        listening: from :func:`bound`; closed at the end.
        ready: called with the address of the page when it can be opened.
    """
    own = int(listening.getsockname()[1])
    token, jobs = secrets.token_urlsafe(24), Jobs(session.folder)
    app = Guard(make(session, jobs, limit), token, own)
    config = uvicorn.Config(
        app,
        log_level="critical" if os.environ.get("WT_DEBUG", "0") in ("", "0") else "error",
        access_log=False,
        server_header=False,
        ws="none",
        timeout_graceful_shutdown=1,
    )
    server = _Server(config, lambda: ready(f"http://{ADDRESS}:{own}/{token}/"))
    try:
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[listening])
    finally:
        jobs.stop()
        listening.close()


class _Server(uvicorn.Server):
    """Says when it listens."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        self._ready()


def bound(port: int | None) -> socket.socket:
    """A socket of the loopback.

    Args:
        port: to listen on; None for the usual one, or another if that is in use.

    Raises:
        UserError: the port is in use.
        WorkError: no port is free.
    """
    for number in (PORT, 0) if port is None else (port,):
        listening = socket.socket()
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((ADDRESS, number))
        except OSError as error:
            listening.close()
            if port is not None and error.errno in (errno.EADDRINUSE, errno.EACCES):
                raise UserError(f"--port {port} is in use or not allowed; give another") from error
            continue
        return listening
    raise WorkError("no free network port; close a program that listens on many")
