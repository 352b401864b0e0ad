"""Guard of the page's server: lets in nobody but the page that this server has sent."""

from __future__ import annotations

import secrets
from urllib.parse import parse_qs

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fpsboost import InputError

MAX_BODY = 64 * 1024
"""Largest body of a request, bytes; the page sends a few hundred."""

HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address has the token
    "X-Content-Type-Options": "nosniff",
}


class Guard:
    """Middleware that answers requests of other programs, other pages and other machines with an error.

    A request needs the token of this run, which keeps out other programs of this machine that do not know it; a Host
    header of this server, so that no other name can be made to lead here (DNS rebinding); and, if it changes something,
    the Origin of the page, so that no other page can send it.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app, self._token = app, token.encode()
        self._hosts = {f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; see the ASGI specification."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                more = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", []), *more]}
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, _limited(receive), sent)
        else:
            await JSONResponse({"notice": refusal}, 403)(scope, receive, sent)

    def _refusal(self, scope: Scope) -> str | None:
        """Return the sentence with which a request is refused; None if it is let in."""
        headers: dict[bytes, bytes] = dict(scope["headers"])
        host = headers.get(b"host", b"")
        if host not in self._hosts:
            return "This is not the address of fpsboost; open the one that it has printed."
        given = headers.get(b"x-fpsboost-token") or parse_qs(scope["query_string"]).get(b"token", [b""])[0]
        if not secrets.compare_digest(given, self._token):
            return "The token is not that of this run; open the address that fpsboost has printed."
        if scope["method"] not in ("GET", "HEAD") and headers.get(b"origin") != b"http://" + host:
            return "Another page has sent this; open the address that fpsboost has printed."
        return None


def _limited(receive: Receive) -> Receive:
    """Return a function that receives a body up to the limit."""
    size = 0

    async def limited() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > MAX_BODY:
            raise InputError(f"The page has sent more than {MAX_BODY} bytes; load it anew.")
        return message

    return limited
