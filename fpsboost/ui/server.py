"""The page's server: each request is answered by a function of the library or of the queue, behind a guard.

The guard accepts requests only from the page that this server has sent.
"""

import hmac
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
from threading import Event, Semaphore
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fpsboost import FpsboostError, InputError, OptionError
from fpsboost.cli.errors import explain
from fpsboost.pages import templates_of
from fpsboost.ui.choices import Choices, first_choices, on_page
from fpsboost.ui.clip import header, place_of, poster, preview_between, probe
from fpsboost.ui.files import Files, show_in_folder
from fpsboost.ui.jobs import Queue

MAX_BODY = 1024 * 1024
"""Largest body of a request, bytes; the page sends a few hundred for each clip."""

READERS = 4
"""Number of clips that are read at a time: to their ends, for one frame, or to check a conversion; any more have to
wait."""

MEDIA = ("result", "source", "poster")
"""Files of a finished job that the page shows, each by an address of its own."""

HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the addresses of results have keys
    "X-Content-Type-Options": "nosniff",
}
"""Headers of every answer, which restrict what other pages can do with it."""

Json = dict[str, Any]
"""Object of a request or an answer."""


@dataclass
class UiSession:
    """State and services of one run of the page."""

    files: Files
    """Files that the page may use."""
    queue: Queue
    """Queue of conversions."""
    start: Path
    """Folder that is listed first."""
    token: str
    """Secret of this run, by which the page proves that it belongs to it."""
    port: int
    """Port of the server."""
    _checks: Semaphore = field(default_factory=lambda: Semaphore(READERS))  # few, since each may open an encoder

    def folder(self, data: Json) -> Json:
        """Return the content of a folder."""
        return self.files.listing(str(data.get("path") or self.start))

    def find(self, data: Json) -> Json:
        """Return the paths of files that were dropped on the page."""
        wanted = data.get("files")
        if not isinstance(wanted, list) or not all(isinstance(each, dict) for each in wanted):
            raise OptionError("The page has sent no files; reload it.")
        return self.files.find(wanted, str(data.get("folder") or self.start))

    def pick(self, data: Json) -> Json:
        """Return the header of a clip, and allow that it is read from now on."""
        path = self.files.pick(str(data.get("path", "")))
        return {**header(path), "choices": asdict(self._named(first_choices(path), self.queue.outputs()))}

    def probe(self, data: Json, is_dropped: Event) -> Json:
        """Return the properties of a clip that is read to its end."""
        path = str(data.get("path", ""))
        self.files.check_picked(path)
        return probe(path, is_dropped)

    def check(self, data: Json) -> Json:
        """Return the properties of the outputs of some clips, without converting them."""
        return {"clips": [found for found, _ in self._conversions(data)]}

    def look(self, data: Json, _: Event) -> Json:
        """Return a frame between two, by a method and by blending; once begun, it is computed to its end."""
        choices = Choices.of(data.get("choices"))
        time = data.get("time")
        if not isinstance(time, int | float) or time is True or not 0 <= time < 1e9:
            raise OptionError("The page has sent no valid time; reload it.")
        job = choices.job(self.files)
        return preview_between(job, Fraction(time).limit_denominator(10**9))

    def place(self, data: Json) -> Json:
        """Return the position in a clip that was typed, as the page's slider counts it."""
        path = str(data.get("path", ""))
        self.files.check_picked(path)
        return {"time": place_of(path, str(data.get("text", "")))}

    def add(self, data: Json) -> Json:
        """Add the conversions of some clips to the queue: all of them, or none."""
        return {"numbers": self.queue.add(*(words for _, words in self._conversions(data)))}

    def _conversions(self, data: Json) -> Iterator[tuple[Json, list[str]]]:
        """Yield the properties of each clip's output in a request, and the words of its command line.

        The output gets a free name if the user has not written one. An error names its clip if there are several.
        """
        clips = data.get("clips")
        if not isinstance(clips, list) or not clips:
            raise OptionError("The page has sent no clips; reload it.")
        outputs = self.queue.outputs()
        for each in clips:
            choices = Choices.of(each)
            try:
                choices = self._named(choices, outputs) if each.get("is_named") is False else choices
                job = choices.job(self.files)
                with self._checks:
                    found = choices.check(job)
                    words = choices.words(job)
            except FpsboostError as error:
                if len(clips) == 1:
                    raise
                raise OptionError(f"{Path(choices.input).name}: {error}") from error
            outputs.add(words[2].rstrip("/"))
            yield {**found, "name": choices.name, "command": shlex.join(words)}, words

    def _named(self, choices: Choices, outputs: Collection[str]) -> Choices:
        """Return the choices with a name that no other output and, unless it is to be replaced, no file has."""
        folder = self.files.inside(choices.folder)
        name = choices.name
        suffix = "/" if name.endswith("/") else Path(name).suffix
        stem = re.sub(r"-\d+$", "", name.removesuffix(suffix))
        numbers = count(2)
        while str(folder / name) in outputs or (os.path.lexists(folder / name) and not choices.overwrite):
            name = f"{stem}-{next(numbers)}{suffix}"
        return replace(choices, name=name)

    def jobs(self) -> list[Json]:
        """Return the queue, with the addresses of the files that the page shows of each job.

        Each address has a key that is valid for it alone.
        """
        listing = self.queue.listing()
        for job in listing:
            job["media"] = {kind: with_key(f"/{kind}/{job['number']}", self.token) for kind in MEDIA}
        return listing

    def change(self, data: Json) -> Json:
        """Pause, resume, remove or show a job."""
        actions: dict[str, Callable[[int], None]] = {
            "pause": self.queue.pause,
            "resume": self.queue.resume,
            "remove": self.queue.remove,
            "show": lambda number: show_in_folder(self.result(str(number), "place")),
        }
        number = data.get("number")
        action = data.get("action")
        if type(number) is not int or not isinstance(action, str) or action not in actions:
            raise OptionError("The page has sent no valid action; reload it.")
        actions[action](number)
        return {}

    def result(self, number: str, kind: str = "result") -> Path:
        """Return the file that a job has written, or its source; as a place or for a poster, a folder as well.

        Raises `OptionError` if the job is not done, and `InputError` if the file is gone or is a link now.
        """
        job = self.queue.job(int(number) if re.fullmatch(r"[0-9]{1,9}", number) else 0)
        if job.state != "done":
            raise OptionError(f"Job {number} is not done; wait for it.")
        given, was = (job.words[1], "converted") if kind == "source" else (job.output, "written")
        path = self.files.inside(given)
        if path != Path(given) or not (path.is_file() or (kind in ("place", "poster") and path.is_dir())):
            raise InputError(f"{given} is no longer the file that was {was}.")
        return path


def with_key(path: str, token: str) -> str:
    """Return a path with a key that is valid for it alone, for media elements, which cannot send a header.

    The token cannot be computed from the key.
    """
    return f"{path}?key={hmac.digest(token.encode(), path.encode(), 'sha256').hex()}"


class Guard:
    """ASGI middleware that rejects requests of other programs, other pages and other machines.

    A request needs a Host header of this server, so that no other name can be made to lead here (DNS rebinding); the
    token of this run, which keeps out other users of this machine; and, if it changes something, the Origin of the
    page, so that no other page can send it. The page itself, which holds no data, needs no token.

    The page gets the token behind the # of its address, which no browser sends anywhere, removes it from there and
    sends it in a header. It is no cookie: browsers send a cookie to every port of this machine, so to servers of its
    other users, and with requests that other pages make.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app = app
        self._token = token
        self._hosts = [f"{name}:{port}" for name in ("127.0.0.1", "localhost")]
        self._refused = templates_of("fpsboost.ui").get_template("refused.html.j2")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; see the ASGI specification."""
        if scope["type"] != "http":  # begin or end of the server; for anything else there is no route
            await self._app(scope, receive, send)
            return

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        request = Request(scope)
        refusal = self._refusal(request)
        if refusal is None:
            await self._app(scope, receive, sent)
        else:
            page = self._refused.render(notice=refusal, address=f"http://{self._hosts[0]}/")
            await HTMLResponse(page, 403)(scope, receive, sent)

    def _refusal(self, request: Request) -> str | None:
        """Return the reason for which a request is rejected, as a sentence; None if it is accepted."""
        headers = request.headers
        reads = request.method in ("GET", "HEAD")
        path = request.scope["path"]
        if headers.get("host") not in self._hosts:
            return "This is not the address of fpsboost; open the one that it has printed."
        if reads and path == "/":
            return None
        given = headers.get("x-fpsboost-token", "")
        right = self._token
        if reads and not given:
            given = f"{path}?{request.url.query}"
            right = with_key(path, self._token)
        if not hmac.compare_digest(given.encode(), right.encode()):
            return "The token is not that of this run; open the address that fpsboost has printed."
        if not reads and headers.get("origin") != f"http://{headers['host']}":
            return "Another page has sent this; open the address that fpsboost has printed."
        return None


def make_app(session: UiSession) -> ASGIApp:
    """Return the server's ASGI application, behind its guard."""
    template = templates_of("fpsboost.ui").get_template("ui.html.j2")

    async def page(request: Request) -> Response:
        nonce = secrets.token_urlsafe(16)
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; style-src-attr 'unsafe-inline'"
            "; img-src 'self' data:; media-src 'self'; connect-src 'self'; form-action 'none'; base-uri 'none'; "
            "frame-ancestors 'none'"
        )
        return HTMLResponse(template.render(nonce=nonce), headers={"Content-Security-Policy": policy})

    # these two run in threads, since they wait for the queue or for a disk, which may be on a network

    def jobs(request: Request) -> Response:
        return Answer(session.jobs())

    def media(request: Request) -> Response:
        _, kind, number = request.url.path.split("/")
        path = session.result(number, kind)
        return Response(poster(str(path)), media_type="image/jpeg") if kind == "poster" else FileResponse(path)

    def answering(answer: Callable[[Json], Json]) -> Callable[[Request], Any]:
        """Return an endpoint that answers an object with an object; the function runs in a thread."""

        async def endpoint(request: Request) -> Response:
            return Answer(await run_in_threadpool(answer, await _data_of(request)))

        return endpoint

    def working(answer: Callable[[Json, Event], Json], pool: ThreadPoolExecutor) -> Callable[[Request], Any]:
        """Return an endpoint for long work, which has a pool of its own and is dropped when its client disconnects."""

        async def endpoint(request: Request) -> Response:
            data = await _data_of(request)
            is_dropped = Event()
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

    lookers = ThreadPoolExecutor(READERS)
    readers = ThreadPoolExecutor(READERS)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        readers.shutdown()  # which waits until their processes are stopped

    actions = session.folder, session.find, session.pick, session.place, session.check, session.add, session.change
    app = Starlette(
        routes=[
            Route("/", page),
            Route("/jobs", jobs),
            *(Route(f"/{kind}/{{number}}", media) for kind in MEDIA),
            *(Route(f"/{each.__name__}", answering(each), methods=["POST"]) for each in actions),
            Route("/look", working(session.look, lookers), methods=["POST"]),
            Route("/probe", working(session.probe, readers), methods=["POST"]),
        ],
        lifespan=lifespan,
        exception_handlers={
            **dict.fromkeys((FpsboostError, OSError, MemoryError, ClientDisconnect), _notice),
            Exception: _fault,
        },
    )
    return Guard(app, session.token, session.port)


class Answer(JSONResponse):
    """JSON in ASCII, since names of files need not be Unicode."""

    def render(self, content: Any) -> bytes:
        """Return the body of the answer."""
        return json.dumps(content).encode()


async def _data_of(request: Request) -> Json:
    """Return the JSON object in a request; raises `OptionError` for anything else."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MAX_BODY:
            raise InputError(f"The page has sent more than {MAX_BODY} bytes; reload it.")
    try:
        data = json.loads(body)
        os.fsencode(json.dumps(data, ensure_ascii=False))  # names need not be Unicode, but must be valid for files
    except (ValueError, RecursionError) as error:
        raise OptionError("The page has sent data that is not JSON; reload it.") from error
    return data if isinstance(data, dict) else {}


async def _left(request: Request) -> None:
    """Return when the client of a request has disconnected."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _notice(request: Request, error: Exception) -> Response:
    """Answer an expected error with the sentence that the command line would print."""
    return Answer({"notice": on_page(" ".join([explain(error), *getattr(error, "__notes__", ())]))}, 400)


async def _fault(request: Request, error: Exception) -> Response:
    """Answer an unexpected error, which is a fault of the program."""
    return Answer({"notice": explain(error)}, 500)
