"""The page's server: its requests, each answered by a function of the library or of the queue, and its guard.

The guard lets in nobody but the page that this server has sent.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shlex
from asyncio import FIRST_COMPLETED, create_task, wait, wrap_future
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass, field, replace
from fractions import Fraction
from itertools import count
from pathlib import Path
from textwrap import shorten
from threading import Event, Lock
from typing import Any
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fpsboost import FpsboostError, InputError, OptionError
from fpsboost.cli.app import MAX_REASON, explain
from fpsboost.errors import notes_of
from fpsboost.evaluation.report.self_contained import data_uri, templates_of
from fpsboost.ui.choices import Choices, on_page
from fpsboost.ui.clip import header, look_between, probe
from fpsboost.ui.files import Files, show_in_folder
from fpsboost.ui.jobs import Queue

MAX_BODY = 1024 * 1024
"""Largest body of a request, bytes; the page sends a few hundred for each clip."""

READERS = 4  # number of clips that are read to their ends at a time

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
    _one_check: Lock = field(default_factory=Lock)  # at a time, since it may open an encoder

    def folder(self, data: Json) -> Json:
        return self.files.listing(str(data.get("path") or self.start))

    def find(self, data: Json) -> Json:
        """Return where files lie that were dropped on the page."""
        wanted = data.get("files")
        if not isinstance(wanted, list) or not all(isinstance(each, dict) for each in wanted):
            raise OptionError("The page has sent no files; load it anew.")
        paths, missing = self.files.find(wanted, str(data.get("folder") or self.start))
        return {"paths": paths, "missing": missing}

    def pick(self, data: Json) -> Json:
        """Return the header of a clip, which may be read from now on."""
        found = header(self.files.pick(str(data.get("path", ""))))
        return {**found, "choices": asdict(self._named(Choices(**found["choices"]), self.queue.outputs()))}

    def probe(self, data: Json, is_dropped: Event) -> Json:
        """Return the properties of a clip, read to its end."""
        path = str(data.get("path", ""))
        self.files.check_picked(path)
        return probe(path, is_dropped)

    def check(self, data: Json) -> Json:
        return {"clips": [found for found, _ in self._conversions(data)]}

    def look(self, data: Json, is_dropped: Event) -> Json:
        """Return a frame between two, by a method and by blending; nothing if nobody waits for it any more."""
        if is_dropped.is_set():
            return {}
        choices, time = Choices.of(data.get("choices")), data.get("time")
        if not isinstance(time, int | float) or time is True or not 0 <= time < 1e9:
            raise OptionError("The page has sent no valid time; load it anew.")
        job = choices.job(self.files)
        frame = look_between(job, Fraction(time).limit_denominator(10**9))
        return {
            "images": [data_uri(each, "jpeg") for each in (frame.blended, frame.interpolated)],
            "between": f"between {' and '.join(frame.neighbours)}",
            "is_cut": frame.is_cut,
        }

    def add(self, data: Json) -> Json:
        """Add the conversions of some clips to the queue: all of them, or none."""
        return {"numbers": self.queue.add(*(words for _, words in self._conversions(data)))}

    def _conversions(self, data: Json) -> Iterator[tuple[Json, list[str]]]:
        """Yield what the conversion of each clip in a request would give, and the words of its command line.

        Its name is a free one if the user has not written it. An error names its clip if there are several.
        """
        clips = data.get("clips")
        if not isinstance(clips, list) or not clips:
            raise OptionError("The page has sent no clips; load it anew.")
        outputs = self.queue.outputs()
        for each in clips:
            choices = Choices.of(each)
            try:
                choices = self._named(choices, outputs) if each.get("is_named") is False else choices
                job = choices.job(self.files)
                with self._one_check:
                    found, words = choices.check(job), choices.words(job)
            except FpsboostError as error:
                if len(clips) == 1:
                    raise
                raise OptionError(f"{Path(choices.input).name}: {error}") from error
            outputs.add(words[2].rstrip("/"))
            yield {**found, "name": choices.name, "command": shlex.join(words)}, words

    def _named(self, choices: Choices, outputs: Collection[str]) -> Choices:
        """Return the choices with a name that no file has, unless that is to be replaced, and no other output."""
        folder, name = self.files.inside(choices.folder), choices.name
        suffix = "/" if name.endswith("/") else Path(name).suffix
        stem = re.sub(r"-\d+$", "", name.removesuffix(suffix))
        numbers = count(2)
        while str(folder / name) in outputs or (os.path.lexists(folder / name) and not choices.overwrite):
            name = f"{stem}-{next(numbers)}{suffix}"
        return replace(choices, name=name)

    def change(self, data: Json) -> Json:
        actions = {"pause": self.queue.pause, "resume": self.queue.resume, "remove": self.queue.remove}
        actions["show"] = lambda number: show_in_folder(self.result(str(number), "place"))
        number, action = data.get("number"), data.get("action")
        if type(number) is not int or not isinstance(action, str) or action not in actions:
            raise OptionError("The page has sent no valid action; load it anew.")
        actions[action](number)
        return {}

    def result(self, number: str, kind: str = "result") -> Path:
        """Return the file that a job has written, or its source; as a place, a folder as well."""
        job = self.queue.job(int(number) if re.fullmatch(r"[0-9]{1,9}", number) else 0)
        if job.state != "done":
            raise OptionError(f"Job {number} is not done; wait for it.")
        given, was = (job.words[1], "converted") if kind == "source" else (job.output, "written")
        path = self.files.inside(given)
        if path != Path(given) or not (path.is_file() or (kind == "place" and path.is_dir())):
            raise InputError(f"{given} is no longer the file that was {was}.")
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

        is_answered = False

        async def sent(message: Message) -> None:
            nonlocal is_answered
            if message["type"] == "http.response.start":
                is_answered = True
                more = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", []), *more]}
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            try:
                await self._app(scope, _limited(receive), sent)
            except ClientDisconnect:
                pass  # nobody waits for an answer
            except Exception as error:
                if is_answered:
                    raise
                reason = shorten(f"{type(error).__name__}: {error}", MAX_REASON)
                await Answer({"notice": f"This is a fault in fpsboost ({reason}); report it."}, 500)(
                    scope, receive, sent
                )
        else:
            await Answer({"notice": refusal}, 403)(scope, receive, sent)

    def _refusal(self, scope: Scope) -> str | None:
        """Return the sentence with which a request is refused; None if it is let in."""
        headers: dict[bytes, bytes] = dict(scope["headers"])
        host = headers.get(b"host", b"")
        if host not in self._hosts:
            return "This is not the address of fpsboost; open the one that it has printed."
        query = parse_qs(scope["query_string"].decode("latin-1"))
        given = headers.get(b"x-fpsboost-token") or query.get("token", [""])[0].encode()
        if not secrets.compare_digest(given, self._token):
            return "The token is not that of this run; open the address that fpsboost has printed."
        if scope["method"] not in ("GET", "HEAD") and headers.get(b"origin") != b"http://" + host:
            return "Another page has sent this; open the address that fpsboost has printed."
        return None


def _limited(receive: Receive) -> Receive:
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
        return Answer(desk.queue.listing())

    async def result(request: Request) -> Response:
        return FileResponse(desk.result(request.path_params["number"], request.url.path.split("/")[1]))

    def answering(answer: Callable[[Json], Json]) -> Callable[[Request], Any]:
        async def endpoint(request: Request) -> Response:
            return Answer(await run_in_threadpool(answer, await _data_of(request)))

        return endpoint

    def working(answer: Callable[[Json, Event], Json], pool: ThreadPoolExecutor) -> Callable[[Request], Any]:
        """Return an endpoint for long work, which waits in a pool of its own and ends when nobody waits for it."""

        async def endpoint(request: Request) -> Response:
            data, is_dropped = await _data_of(request), Event()
            work = wrap_future(pool.submit(answer, data, is_dropped))
            leaving = create_task(_left(request))
            try:
                await wait((work, leaving), return_when=FIRST_COMPLETED)
                return Answer(await work) if work.done() else Response()
            finally:
                is_dropped.set()
                leaving.cancel()
                work.cancel()

        return endpoint

    posts = (desk.folder, desk.find, desk.pick, desk.check, desk.add, desk.change)
    # one look at a time, so that it takes no more memory than a conversion
    lookers, readers = ThreadPoolExecutor(1), ThreadPoolExecutor(READERS)
    works = {"/look": working(desk.look, lookers), "/probe": working(desk.probe, readers)}

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        readers.shutdown()  # which waits until their processes are stopped

    return Starlette(
        routes=[
            Route("/", page),
            Route("/jobs", jobs),
            *(Route(f"/{kind}/{{number}}", result) for kind in ("result", "source")),
            *(Route(f"/{each.__name__}", answering(each), methods=["POST"]) for each in posts),
            *(Route(path, work, methods=["POST"]) for path, work in works.items()),
        ],
        lifespan=lifespan,
        middleware=[Middleware(Guard, token=desk.token, port=desk.port)],
        exception_handlers={FpsboostError: _notice, OSError: _notice, MemoryError: _notice},
    )


class Answer(JSONResponse):
    """JSON in ASCII, since names of files need not be Unicode."""

    def render(self, content: Any) -> bytes:
        return json.dumps(content).encode()


async def _data_of(request: Request) -> Json:
    """Return the object in a request; raise `OptionError` for what no page sends."""
    try:
        data = await request.json()
        os.fsencode(json.dumps(data, ensure_ascii=False))  # names of files need not be Unicode, but are not anything
    except (ValueError, RecursionError) as error:
        raise OptionError("The page has sent what is no JSON; load it anew.") from error
    return data if isinstance(data, dict) else {}


async def _left(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _notice(request: Request, error: Exception) -> Response:
    """Answer with the sentence that the command line would print."""
    sentence = explain(error) if isinstance(error, OSError | MemoryError) else str(error)
    return Answer({"notice": on_page(" ".join(filter(None, (sentence, notes_of(error)))))}, 400)
