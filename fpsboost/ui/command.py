"""Command `fpsboost ui`: serves the page on this machine until it is stopped."""

from __future__ import annotations

import os
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
from fpsboost.cli.options import PathName

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
        Port of this machine; the queue is the same on each.
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
    path = platformdirs.user_state_path("fpsboost", appauthor=False) / "queue.json"
    try:
        with closing(Queue(path, files)) as queue, _bound(port) as bound:
            port = bound.getsockname()[1]
            desk = Desk(files, queue, files.root or Path.home(), token, port)
            config = uvicorn.Config(make_app(desk), log_level="critical", access_log=False, timeout_graceful_shutdown=1)
            address = f"http://127.0.0.1:{port}/?token={token}"
            console.print(f"The page: {address}", soft_wrap=True)
            console.print("Ctrl-C stops it; conversions that are not done can go on later.")
            if queue.outside:
                count = len(queue.outside)
                console.print(f"Earlier conversions outside of {files.root} do not go on from here: {count}.")
            if not no_browser:
                webbrowser.open(address)
            uvicorn.Server(config).run(sockets=[bound])
    except KeyboardInterrupt:
        console.print("Stopped.")
        sys.stdout.flush()
        os._exit(0)  # without waiting for a frame that is being computed, which nobody sees any more


def _bound(port: int) -> socket.socket:
    """Return a socket on a port of this machine that other machines cannot reach."""
    bound = socket.socket()
    try:
        if os.name == "posix":  # a port that was in use a minute ago; elsewhere the option takes it from who uses it
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(("127.0.0.1", port))
        bound.listen()
    except (OSError, OverflowError) as error:
        bound.close()
        reason = error.strerror if isinstance(error, OSError) else "it must be 0 to 65535"
        raise OptionError(f"--port {port} cannot be used ({reason}); name another, or 0 for any.") from error
    return bound
