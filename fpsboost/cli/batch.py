"""Several inputs into one folder: each gets a place there, and one that fails does not stop the rest."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from fpsboost.cli.messages import console, say_error, say_traceback, shown
from fpsboost.errors import CompleteAlreadyError, FpsboostError, OptionError, OutputError, explained
from fpsboost.io.animation.canvas import ANIMATION_SUFFIXES
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.numbering import is_pattern
from fpsboost.io.opening import PIPES
from fpsboost.io.video.encoding import VIDEO_SUFFIXES

WRITTEN = (*VIDEO_SUFFIXES, *ANIMATION_SUFFIXES)
OTHER_VIDEOS_BECOME = ".mkv"
"""Which holds every sound and every subtitle, so that no input fails for its ending."""

Convert = Callable[[str, str | None, str], None]
"""Convert an input to an output, None for beside it; the third text says which of how many it is."""


def plan_outputs(inputs: Sequence[str], folder: str) -> list[str]:
    """Choose a path for what becomes of each input.

    Parameters
    ----------
    inputs : sequence of str
        Video files, folders and patterns of images.
    folder : str
        It need not exist.

    Returns
    -------
    list of str
        A video keeps its name, and its ending if that can be written; images go into a folder of their folder's name.

    Raises
    ------
    OptionError
        There is a pipe among the paths, `folder` is none, or two inputs would have one name.
    """
    if folder in PIPES or any(path in PIPES for path in inputs):
        raise OptionError("A pipe is one clip; convert several inputs with names, into a folder.")
    is_folder = os.path.isdir(folder)  # unlike pathlib's, without an exception for names that cannot be
    is_file = os.path.exists(folder) and not is_folder
    looks_like_file = not is_folder and extension_of(folder) in (*WRITTEN, *IMAGE_SUFFIXES)
    if is_file or looks_like_file or is_pattern(folder):
        raise OptionError(f"{folder} is no folder, and {len(inputs)} inputs need one; name a folder last.")
    outputs: dict[str, str] = {}
    taken: dict[str, str] = {}
    for path in inputs:
        output = _place_of(path, Path(folder))
        clash = taken.setdefault(output.casefold(), path)  # on many disks capital letters make no difference
        if path in outputs or clash != path:
            raise OptionError(f"{clash} and {path} would both become {output}; convert one of them by itself.")
        outputs[path] = output
    return list(outputs.values())


def _place_of(path: str, folder: Path) -> str:
    if os.path.isdir(path) or (is_pattern(path) and not os.path.isfile(path)):
        images = Path(path) if os.path.isdir(path) else Path(path).parent
        return f"{folder / images.resolve().name}/"
    suffix = Path(path).suffix if extension_of(path) in WRITTEN else OTHER_VIDEOS_BECOME
    return str(folder / f"{Path(path).stem}{suffix}")


def convert_each(inputs: Sequence[str], folder: str, convert: Convert, *, quiet: bool, verbose: bool) -> None:
    """Convert every input into a folder and say how many failed, with exit code 1 if any did.

    Parameters
    ----------
    inputs : sequence of str
    folder : str
        Made if it is missing, and removed again if nothing came into it.
    convert : callable
        Does one; what it raises is printed, and the next one goes on.
    quiet : bool
        Only say what fails.
    verbose : bool
        Show tracebacks.

    Raises
    ------
    OptionError
        See `plan_outputs`.
    OutputError
        The folder cannot be made.
    KeyboardInterrupt
        With a note about what is done.
    """
    outputs = plan_outputs(inputs, folder)
    is_new = not os.path.isdir(folder)
    if is_new and not os.path.isdir(Path(folder).absolute().parent):
        raise OutputError(f"The folder {Path(folder).parent} does not exist; create it first.")
    with explained(OutputError, "make the folder", folder, "check the path and the permissions"):
        Path(folder).mkdir(exist_ok=True)
    try:
        _convert_all(inputs, outputs, convert, quiet=quiet, verbose=verbose)
    finally:
        if is_new:
            with suppress(OSError):
                Path(folder).rmdir()  # which only works while it is empty


def convert_in_place(inputs: Sequence[str], convert: Convert, *, quiet: bool, verbose: bool) -> None:
    """Convert several sequences of images, each beside its own; otherwise like `convert_each`."""
    _convert_all(inputs, [None] * len(inputs), convert, quiet=quiet, verbose=verbose)


def _convert_all(
    inputs: Sequence[str], outputs: Sequence[str | None], convert: Convert, *, quiet: bool, verbose: bool
) -> None:
    messages = console()
    done, failed = 0, []
    try:
        for number, (path, output) in enumerate(zip(inputs, outputs, strict=True), 1):
            try:
                convert(path, output, f"{number}/{len(inputs)} ")
                done += 1
            except CompleteAlreadyError as already:
                if not quiet:
                    messages.print(shown(str(already)))
                done += 1
            except FpsboostError as error:
                if verbose:
                    say_traceback()
                say_error(messages, error)
                failed.append(path)
    except KeyboardInterrupt as stopped:
        stopped.add_note(f"{done} of {len(inputs)} inputs were converted.")
        raise
    if failed:
        messages.print(f"[red]fpsboost:[/] {len(failed)} of {len(inputs)} inputs failed: {shown(', '.join(failed))}.")
        sys.exit(1)
    if not quiet:
        messages.print(f"All {len(inputs)} inputs were converted.")
