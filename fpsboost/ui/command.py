"""Command `fpsboost ui`: serves the page on this machine until it is stopped."""

import os
import re
import secrets
import socket
import sys
import webbrowser
from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter
from rich.console import Console

from fpsboost import InUseError, OptionError
from fpsboost.cli.options import PathName
from fpsboost.extension import write_safely

options = Group("Options", sort_key=1)

REDIRECTION = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>fpsboost</title>
<meta http-equiv="refresh" content="0; url={0}"><a href="{0}">The page of fpsboost</a></html>
"""
"""File that redirects the browser to the page. The address thus is not on a command line, which all users can read."""


def ui(
    folder: Annotated[PathName | None, Parameter(name="FOLDER")] = None,
    /,
    *,
    port: Annotated[int, Parameter(group=options, metavar="N")] = 8517,
    no_browser: Annotated[bool, Parameter(group=options)] = False,
) -> None:
    """Show a page to choose, inspect and convert clips; nothing leaves this machine.

    Parameters
    ----------
    folder
        Restrict the page to this folder. By default, start in the home folder, or open the page of a fpsboost ui that
        is running.
    port
        Port to listen on; all ports share one queue.
    no_browser
        Print the address only.
    """
    try:
        import platformdirs  # noqa: PLC0415 (of the extra, which may be missing)
        import uvicorn  # noqa: PLC0415

        from fpsboost.ui import files, jobs, server  # noqa: PLC0415
    except ImportError as error:
        raise OptionError("The page needs more packages; install them with pip install 'fpsboost[ui]'.") from error
    allowed = files.Files() if folder is None else files.Files(files.Files().inside(folder))
    if allowed.root is not None and not allowed.root.is_dir():
        raise OptionError(f"{folder} is not a folder; name one, or leave it out.")
    console = Console(highlight=False)
    token = secrets.token_urlsafe(24)
    state = platformdirs.user_state_path("fpsboost", appauthor=False)
    page = state / "page.html"
    try:
        with closing(jobs.Queue(state / "queue.json", allowed)) as queue, _bound(port) as bound:
            port = bound.getsockname()[1]
            session = server.UiSession(allowed, queue, allowed.root or Path.home(), token, port)
            config = uvicorn.Config(
                server.make_app(session), log_level="critical", access_log=False, timeout_graceful_shutdown=1
            )
            address = f"http://127.0.0.1:{port}/#{token}"
            write_safely(page, REDIRECTION.format(address).encode(), jobs.PRIVATE)
            console.print(
                f"The page: {address}\nCtrl-C stops it; unfinished conversions can be continued later.", soft_wrap=True
            )
            if queue.outside:
                console.print(f"Earlier conversions outside of {allowed.root} are not continued: {len(queue.outside)}.")
            if not no_browser:
                webbrowser.open(page.as_uri())
            uvicorn.Server(config).run(sockets=[bound])
    except InUseError:
        if folder is not None or not page.is_file():
            raise
        (address,) = set(re.findall(r'http:[^"]+', page.read_text()))
        console.print(f"The page, which is running already: {address}", soft_wrap=True)
        if not no_browser:
            webbrowser.open(page.as_uri())
    except KeyboardInterrupt:
        console.print("Stopped.")
        sys.stdout.flush()
        os._exit(0)  # without waiting for a frame that is being computed for the page


def _bound(port: int) -> socket.socket:
    """Return a socket bound to a port of the loopback interface, which other machines cannot reach."""
    try:
        return socket.create_server(("127.0.0.1", port))  # also one that was in use a minute ago, and not by any other
    except (OSError, OverflowError) as error:
        reason = os.strerror(error.errno or 0) if isinstance(error, OSError) else "it must be 0 to 65535"
        raise OptionError(f"--port {port} cannot be used ({reason}); name another, or 0 for any.") from error
