"""Nobody but the page itself: who asks under another name, from elsewhere or without the token."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

PAGE = (
    "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
"""What the page may load: its own files and nothing else, and no script or style within it."""
REPORT = (
    "sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
"""… and a report, whose scripts and styles are within it: nothing at all, as a page of nobody's."""
_HEADERS = {
    b"content-security-policy": PAGE.encode(),
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"same-origin",  # without one, browsers send no Origin
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"cache-control": b"no-store",
}
"""Of every answer that does not set its own."""


class Guard:
    """Lets requests through that the page of this server makes, below the token's path.

    A page elsewhere that has its name resolve to this machine (DNS rebinding) asks under its own
    name, in the header Host; one that posts here says so in Origin; and none knows the token.
    """

    def __init__(self, app: App, token: str, port: int) -> None:
        """Guard an application.

        Args:
            app: what answers, below ``/<token>``.
            token: first part of every path.
            port: of the server.
        """
        self._app, self._prefix = app, f"/{token}"
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it in one line."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return  # no web sockets

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own: dict[bytes, bytes] = dict(message["headers"])
                message["headers"] = list((_HEADERS | own).items())
            await send(message)

        status, line = self._refused(scope)
        if status:
            await _answer(with_headers, status, line)
            return
        inside = scope["path"].removeprefix(self._prefix)
        await self._app(
            {**scope, "path": inside, "raw_path": inside.encode()}, receive, with_headers
        )

    def _refused(self, scope: Scope) -> tuple[int, str]:
        """Status and line for a request that is not to be answered; 0 for one that is."""
        headers = {name.decode("latin-1"): v.decode("latin-1") for name, v in scope["headers"]}
        host = headers.get("host", "")
        if host not in self._hosts:
            return 403, "this server answers to 127.0.0.1 only"
        start = scope["path"][: len(self._prefix) + 1]
        if not secrets.compare_digest(start.encode(), f"{self._prefix}/".encode()):
            return 404, "nothing is here; open the address that wt studio printed"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return 403, "another page may not ask this server"
        if scope["method"] not in ("GET", "HEAD") and headers.get("origin") != f"http://{host}":
            return 403, "another page may not post to this server"
        return 0, ""


async def _answer(send: Send, status: int, line: str) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{line}\n".encode()})
