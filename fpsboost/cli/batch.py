"""Conversion of several inputs into one folder; an input that fails does not stop the rest."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

from fpsboost.cli.messages import console, literal, say_error, say_traceback, sentence
from fpsboost.cli.options import MessageOptions
from fpsboost.errors import CompleteAlreadyError, FpsboostError, OptionError, OutputError, explained
from fpsboost.io.animation import is_animation
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.source import is_pattern, pictures_in
from fpsboost.io.opening import PIPES
from fpsboost.preparation import OUTPUT_SUFFIXES, name_in_folder
from fpsboost.remarks import Remarks

Convert = Callable[[str, str | None, str], None]
"""Function that converts an input to an output, None for beside it; the third text numbers it, such as ``2/5``."""


def plan_outputs(inputs: Sequence[str], folder: str) -> list[str]:
    """Choose an output path in a folder, which need not exist, for each input.

    A video keeps its name, and its suffix if that can be written; images go into a folder of their folder's name.
    Raises `OptionError` if the last argument is not a folder, or two inputs would get the same output.
    """
    is_folder = os.path.isdir(folder)  # unlike pathlib's, without an exception for impossible names
    is_file = os.path.exists(folder) and not is_folder
    looks_like_file = not is_folder and extension_of(folder) in (*OUTPUT_SUFFIXES, *IMAGE_SUFFIXES)
    if {folder, *inputs} & {*PIPES}:
        raise OptionError("A pipe is one clip; convert several inputs with names, into a folder.")
    if is_file or looks_like_file or is_pattern(folder):
        raise OptionError(f"{folder} is not a folder, and {len(inputs)} inputs need one; name a folder last.")
    outputs = [name_in_folder(path, Path(folder)) for path in inputs]
    by_output: dict[str, str] = {}
    for path, output in zip(inputs, outputs, strict=True):
        clash = by_output.setdefault(output.casefold(), path)  # many file systems ignore case
        if clash != path:
            raise OptionError(f"{clash} and {path} would both become {output}; convert one of them by itself.")
    return outputs


def is_pair(inputs: Sequence[str]) -> bool:
    """Return whether the inputs are two pictures, which make one clip: neither videos nor animations."""
    pair = pictures_in(",".join(inputs)) if len(inputs) == 2 else []
    return bool(pair) and not any(map(is_animation, pair))


def remark_on_last_image(remarks: Remarks, frames_in: int, frames_out: int, multiple: Fraction) -> None:
    """Add the remark that explains why images are fewer than the factor suggests, if they are."""
    if multiple != 1 and frames_out == (frames_in - 1) * multiple + 1:
        remarks.add("last-image", frames=frames_in, images=frames_out, expected=frames_in * multiple)


def check_ending(input: str, output: str) -> None:
    """Raise `OptionError` if a video gets an output that is a folder only because its name has no extension."""
    # all other inputs are images, or refused in their turn, as is an output that is there and no folder
    is_video = input in PIPES or (os.path.isfile(input) and extension_of(input) not in IMAGE_SUFFIXES)
    is_meant = output in PIPES or output.endswith(("/", "\\")) or os.path.lexists(output) or is_pattern(output)
    if output and is_video and not (Path(output).suffix or is_meant):
        ending = extension_of(input) if extension_of(input) in OUTPUT_SUFFIXES else ".mp4"
        raise OptionError(f"{output} has no extension; write {output}{ending}, or {output}/ for a folder of images.")


def convert_each(inputs: Sequence[str], folder: str, convert: Convert, options: MessageOptions) -> None:
    """Convert every input into a folder, which is made if missing, and removed again if it is empty at the end."""
    outputs = plan_outputs(inputs, folder)
    is_new = not os.path.isdir(folder)
    if is_new and not os.path.isdir(Path(folder).absolute().parent):
        raise OutputError(f"The folder {Path(folder).parent} does not exist; create it first.")
    with explained(OutputError, "make the folder", folder, "check the path and the permissions"):
        Path(folder).mkdir(exist_ok=True)
    try:
        convert_all(inputs, outputs, convert, options)
    finally:
        if is_new:
            with suppress(OSError):
                Path(folder).rmdir()  # fails unless it is empty


def convert_all(
    inputs: Sequence[str], outputs: Sequence[str | None], convert: Convert, options: MessageOptions
) -> None:
    """Convert every input to its output, or into its own folder where that is None.

    An input that fails is reported, and the next one follows; at the end the process exits with code 1 if any has
    failed.
    """
    messages = console()
    done = 0
    failed = []
    try:
        for number, (path, output) in enumerate(zip(inputs, outputs, strict=True), 1):
            try:
                convert(path, output, f"{number}/{len(inputs)} ")
                done += 1
            except CompleteAlreadyError as already:
                if options.prints_text:
                    messages.print(sentence(str(already)))
                done += 1
            except FpsboostError as error:
                if options.verbose:
                    say_traceback()
                say_error(messages, error)
                failed.append(path)
    except KeyboardInterrupt as stopped:
        stopped.add_note(f"{done} of {len(inputs)} inputs were converted.")
        raise
    if failed:
        messages.print(f"[red]fpsboost:[/] {len(failed)} of {len(inputs)} inputs failed: {literal(', '.join(failed))}.")
        sys.exit(1)
    if options.prints_text:
        messages.print(f"All {len(inputs)} inputs were converted.")
