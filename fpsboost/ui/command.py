"""Command `fpsboost ui`: serves the page on this machine until it is stopped."""

from __future__ import annotations

import secrets
import socket
import sys
import webbrowser
from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter
from rich.console import Console

from fpsboost import OptionError
from fpsboost.cli.signature import PathName

options = Group("Options", sort_key=1)


def ui(
    folder: Annotated[PathName | None, Parameter(name="FOLDER")] = None,
    /,
    *,
    port: Annotated[int, Parameter(group=options, metavar="N")] = 8517,
    no_browser: Annotated[bool, Parameter(group=options)] = False,
) -> None:
    """Show a page on which clips are chosen, looked at and converted; nothing leaves this machine.

    Parameters
    ----------
    folder
        Use nothing outside of this folder; else begin in the home folder.
    port
        Port of this machine; each has a queue of its own.
    no_browser
        Print the address only.
    """
    try:
        import platformdirs  # noqa: PLC0415 (of the extra, which may be missing)
        import uvicorn  # noqa: PLC0415

        from fpsboost.ui.files import Files  # noqa: PLC0415
        from fpsboost.ui.jobs import Queue  # noqa: PLC0415
        from fpsboost.ui.server import Desk, make_app  # noqa: PLC0415
    except ImportError as error:
        raise OptionError("The page needs more packages; install them with pip install 'fpsboost[ui]'.") from error
    files = Files() if folder is None else Files(Files().inside(folder))
    if files.root is not None and not files.root.is_dir():
        raise OptionError(f"{folder} is no folder; name one, or leave it out.")
    console, token = Console(highlight=False), secrets.token_urlsafe(24)
    with _bound(port) as bound:
        port = bound.getsockname()[1]
        queue = Queue(platformdirs.user_state_path("fpsboost", appauthor=False) / f"queue-{port}.json")
        desk = Desk(files, queue, files.root or Path.home(), token, port)
        config = uvicorn.Config(make_app(desk), log_level="warning", access_log=False, timeout_graceful_shutdown=1)
        address = f"http://127.0.0.1:{port}/?token={token}"
        console.print(f"The page: {address}", soft_wrap=True)
        console.print("Ctrl-C stops it; conversions that are not done can go on later.")
        if not no_browser:
            webbrowser.open(address)
        try:
            with closing(queue), closing(desk.prober):
                uvicorn.Server(config).run(sockets=[bound])
        except KeyboardInterrupt:
            console.print("Stopped.")
            sys.exit()  # without another request to stop, as while the exception is handled there is none


def _bound(port: int) -> socket.socket:
    """Return a socket on a port of this machine that other machines cannot reach."""
    bound = socket.socket()
    try:
        bound.bind(("127.0.0.1", port))
        bound.listen()
    except (OSError, OverflowError) as error:
        bound.close()
        raise OptionError(
            f"--port {port} cannot be used, perhaps because fpsboost ui runs already; open its page, or name another."
        ) from error
    return bound
