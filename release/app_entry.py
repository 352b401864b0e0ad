"""Entry of the app: with nothing it opens the page in the browser, with files that were dropped on it it converts them.

All else is passed to the command line, so that the program in the app's folder is the whole of `fpsboost`, too.
"""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping, Sequence
from contextlib import suppress
from pathlib import Path

OWN_PROCESS = ["-m", "fpsboost"]
"""First arguments of the processes that the page starts by `sys.executable`, which is the app here and not Python."""


def commands(arguments: Sequence[str]) -> list[list[str]]:
    """Return the command lines to run, one after the other, for the arguments of the app.

    Parameters
    ----------
    arguments : sequence of str
        What follows the name of the program: nothing, files and folders, or a command line of `fpsboost`.

    Returns
    -------
    list of list of str
        The page without arguments; a conversion beside each file or folder if all of them exist; else one command line.
    """
    if list(arguments[: len(OWN_PROCESS)]) == OWN_PROCESS:
        return [list(arguments[len(OWN_PROCESS) :])]
    if not arguments:
        return [["ui"]]
    # two files would be an input and an output on the command line
    if all(Path(each).exists() for each in arguments):
        return [[each] for each in arguments]
    return [list(arguments)]


def run(words: list[str]) -> int:
    """Run a command line of `fpsboost` in this process; return its exit code."""
    from fpsboost.__main__ import main  # noqa: PLC0415 (it takes a while, and tests need the rest alone)

    sys.argv[1:] = words
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def restore_library_path(environment: MutableMapping[str, str]) -> None:
    """Let other programs, such as the browser and the file manager, load their own libraries and not those of the app.

    PyInstaller's program puts its folder on the path of libraries where systems have one by that name, and keeps what
    was there. This process has read it already.
    """
    original = environment.pop("LD_LIBRARY_PATH_ORIG", None)
    if original is not None:
        environment["LD_LIBRARY_PATH"] = original
    elif getattr(sys, "frozen", False):
        environment.pop("LD_LIBRARY_PATH", None)


def has_own_window(environment: MutableMapping[str, str]) -> bool:
    """Return whether a window was opened for this program alone, and closes when it ends.

    Windows opens a console for a program that is started from the Explorer; add-to-menu.sh sets a variable.
    """
    is_told = environment.pop("FPSBOOST_KEEP_OPEN", None) is not None
    if sys.platform == "win32":
        from ctypes import c_uint, windll  # noqa: PLC0415 (on Windows only)

        return windll.kernel32.GetConsoleProcessList((c_uint * 2)(), 2) == 1
    return is_told


def main() -> int:
    """Do what the arguments of the app ask for; return the worst exit code, once a window's messages are read."""
    restore_library_path(os.environ)
    is_window = has_own_window(os.environ)
    worst = max([run(words) for words in commands(sys.argv[1:])])
    if is_window:
        with suppress(EOFError):
            input("Press Enter to close this window.")
    return worst


if __name__ == "__main__":
    sys.exit(main())
