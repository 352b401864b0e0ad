"""The page's server: its requests, each answered by a function of the library or of the queue, and its guard.

The guard lets in nobody but the page that this server has sent.
"""

from __future__ import annotations

import secrets
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fpsboost import FpsboostError, InputError, OptionError, format_time
from fpsboost.cli.app import explain
from fpsboost.cli.options import in_flags
from fpsboost.errors import notes_of
from fpsboost.evaluation.report.self_contained import data_uri, templates_of
from fpsboost.ui.choices import Choices
from fpsboost.ui.clip import Prober, header, look_between
from fpsboost.ui.files import Files
from fpsboost.ui.jobs import Queue

MAX_BODY = 64 * 1024
"""Largest body of a request, bytes; the page sends a few hundred."""

HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address has the token
    "X-Content-Type-Options": "nosniff",
}

Json = dict[str, Any]


@dataclass
class Desk:
    """State and services of the page."""

    files: Files
    queue: Queue
    start: Path
    token: str
    port: int
    prober: Prober = field(default_factory=Prober)
    _looking: Lock = field(default_factory=Lock)

    def folder(self, data: Json) -> Json:
        return self.files.listing(str(data.get("path") or self.start))

    def pick(self, data: Json) -> Json:
        """Return the header of a clip, which may be read from now on."""
        return header(self.files.pick(str(data.get("path", ""))))

    def probe(self, data: Json) -> Json:
        """Return the properties of a clip, read to its end."""
        path = str(data.get("path", ""))
        self.files.check_picked(path)
        return self.prober.probe(path)

    def check(self, data: Json) -> Json:
        """Return what a conversion would give, and the command line for it."""
        choices = Choices.of(data)
        job = choices.job(self.files)
        return {**choices.check(job), "command": shlex.join(choices.words(job))}

    def look(self, data: Json) -> Json:
        """Return a frame between two, by a method and by blending."""
        choices, time = Choices.of(data.get("choices")), data.get("time")
        if not isinstance(time, int | float) or time is True or not 0 <= time < 1e9:
            raise OptionError("The page has sent no valid time; load it anew.")
        job = choices.job(self.files)
        with self._looking:  # one at a time, so that it takes no more memory than a conversion
            frame = look_between(job, Fraction(time).limit_denominator(10**9))
        return {
            "images": [data_uri(each, "jpeg") for each in (frame.blended, frame.interpolated)],
            "between": f"between {format_time(frame.begin)} and {format_time(frame.end)}",
            "is_cut": frame.is_cut,
        }

    def add(self, data: Json) -> Json:
        choices = Choices.of(data)
        job = choices.job(self.files)
        choices.check(job)
        return {"number": self.queue.add(choices.words(job), job.output or "")}

    def change(self, data: Json) -> Json:
        """Pause a job, let it go on, or remove it."""
        actions = {"pause": self.queue.pause, "resume": self.queue.resume, "remove": self.queue.remove}
        number, action = data.get("number"), data.get("action")
        if type(number) is not int or action not in actions:
            raise OptionError("The page has sent no valid action; load it anew.")
        actions[action](number)
        return {}

    def result(self, number: int) -> Path:
        """Return the file that a job has written."""
        job = self.queue.job(number)
        if job.state != "done":
            raise OptionError(f"Job {number} is not done; wait for it.")
        path = self.files.inside(job.output)
        if path != Path(job.output) or not path.is_file():
            raise InputError(f"{job.output} is no longer the file that was written.")
        return path


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


def make_app(desk: Desk) -> Starlette:
    """Return the server's application, guarded."""
    template = templates_of("fpsboost.ui").get_template("ui.html.j2")

    async def page(request: Request) -> Response:
        nonce = secrets.token_urlsafe(16)
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; style-src-attr 'unsafe-inline'"
            "; img-src 'self' data:; media-src 'self'; connect-src 'self'; form-action 'none'; base-uri 'none'; "
            "frame-ancestors 'none'"
        )
        return HTMLResponse(template.render(nonce=nonce), headers={"Content-Security-Policy": policy})

    async def jobs(request: Request) -> Response:
        return JSONResponse(desk.queue.listing())

    async def result(request: Request) -> Response:
        return FileResponse(desk.result(request.path_params["number"]))

    def answering(answer: Callable[[Json], Json]) -> Callable[[Request], Any]:
        async def endpoint(request: Request) -> Response:
            try:
                data = await request.json()
            except ValueError as error:
                raise OptionError("The page has sent what is no JSON; load it anew.") from error
            return JSONResponse(await run_in_threadpool(answer, data if isinstance(data, dict) else {}))

        return endpoint

    posts = (desk.folder, desk.pick, desk.probe, desk.check, desk.look, desk.add, desk.change)
    return Starlette(
        routes=[
            Route("/", page),
            Route("/jobs", jobs),
            Route("/result/{number:int}", result),
            *(Route(f"/{each.__name__}", answering(each), methods=["POST"]) for each in posts),
        ],
        middleware=[Middleware(Guard, token=desk.token, port=desk.port)],
        exception_handlers={FpsboostError: _notice, OSError: _notice, MemoryError: _notice},
    )


async def _notice(request: Request, error: Exception) -> Response:
    """Answer with the sentence that the command line would print."""
    sentence = explain(error) if isinstance(error, OSError | MemoryError) else str(error)
    text = " ".join(filter(None, (in_flags(sentence), in_flags(notes_of(error)))))
    return JSONResponse({"notice": text}, 400)
