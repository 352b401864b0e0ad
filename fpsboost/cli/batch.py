"""Conversion of one input or of several; one that fails does not stop the rest."""

from __future__ import annotations

import math
import os
import shlex
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import fpsboost
from fpsboost.cli.errors import PIPE, all_explained
from fpsboost.cli.library_texts import native_stderr_captured
from fpsboost.cli.messages import (
    console,
    literal,
    reporter_of,
    say_error,
    say_traceback,
    sentence,
)
from fpsboost.cli.options import MessageOptions, MethodOptions, check_named_once
from fpsboost.cluster import ClusterOptions, convert_where
from fpsboost.conflicts import check_together
from fpsboost.errors import CompleteAlreadyError, FpsboostError, OptionError, OutputError, explained
from fpsboost.io.animation.source import is_animation
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.source import is_pattern, pictures_in
from fpsboost.io.opening import PIPES
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.options import words_of_options
from fpsboost.preparation import OUTPUT_SUFFIXES, ConversionJob, name_in_folder, output_beside
from fpsboost.remarks import Remarks
from fpsboost.run_options import RunOptions
from fpsboost.threads import one_opencv_thread
from fpsboost.timing.options import Timing


@dataclass
class Conversions:
    """Conversions by one command, which differ in input and output alone."""

    timing: Timing
    method: fpsboost.Interpolator
    method_name: str
    decoding: DecodeOptions
    encoding: Encoding
    run: RunOptions
    where: ClusterOptions
    messages: MessageOptions
    dry_run: bool
    """Whether nothing is written, and the output estimated instead."""
    _explains_last_image: bool = True
    """Whether there may be a remark on the last image, which is printed once."""

    def convert(self, paths: Sequence[str]) -> None:
        """Convert the inputs on the command line, of which the last path is the output if it is not alone.

        With `in_place` there is no output. Raises `OptionError` for options that go with one input only.
        """
        inputs = list(paths)
        output = None
        if not self.run.in_place:
            output = inputs.pop() if len(inputs) > 1 else output_beside(inputs[0], self.timing)
        check_named_once(inputs)
        if output is not None and is_pair(inputs):
            inputs = [",".join(inputs)]
        if len(inputs) == 1:
            self._convert(inputs[0], output)
            return
        check_together(self.method.names_given() | self.run.names_given() | {"several inputs"})
        if self.dry_run:
            self.messages = replace(self.messages, quiet=True, progress="bar")
        if output is None:
            self._convert_all(inputs, [None] * len(inputs))
        else:
            self._convert_into(inputs, output)

    def _convert(self, input: str, output: str | None, place: str = "") -> None:
        """Convert an input to an output, None for beside it; `place` numbers it, such as ``2/5 ``."""
        target = input if output is None else output
        check_ending(input, target)
        job = ConversionJob(input, output, self.timing, self.method, self.decoding, self.encoding)
        if self.dry_run:
            from fpsboost.cli.dry_run import say_dry_run  # noqa: PLC0415 (a page's code is slow to import)

            with one_opencv_thread():
                say_dry_run(job, self.run)
            return
        if self.run.chunk is not None:
            target = str(self.run.chunk.folder(target))
        unfinished = None if self.run.resume or output in (None, PIPE) else target
        with (
            native_stderr_captured(),
            all_explained([input], unfinished),
            reporter_of("standard output" if output == PIPE else target, self.messages, place) as reporter,
            one_opencv_thread(),
        ):
            reporter.say_settings(self.method_name, self.method)
            summary = convert_where(self.where, job, replace(self.run, observer=reporter))
        if job.target(self.run).kind == "images" and not self.run.in_place and self._explains_last_image:
            count = len(summary.remarks)
            remark_on_last_image(summary.remarks, summary.frames_in, summary.frames_out, self.timing.multiple)
            self._explains_last_image = len(summary.remarks) == count
        reporter.say_summary(summary, in_place=self.run.in_place)
        if not (place or self.run.chunk or {input, output} & {None, *PIPES}):
            self._say_next(input)

    def _say_next(self, input: str) -> None:
        """Print on a terminal the command that shows a clip before and after, unless a preview would be refused."""
        errors = console(quiet=not self.messages.prints_text)
        words = ["fpsboost", "preview", input, *words_of_options(self.timing, self.decoding)]
        words += ["-m", self.method_name] * (self.method_name != MethodOptions.method)
        with suppress(OptionError):
            check_together(self.timing.names_given() | {"a preview"})
            if errors.file.isatty():
                errors.print(f"Before and after, on a page: {literal(shlex.join(words))}")

    def _convert_into(self, inputs: Sequence[str], folder: str) -> None:
        """Convert every input into a folder, which is made if missing, and removed again if it is empty at the end."""
        outputs = plan_outputs(inputs, folder)
        is_new = not os.path.isdir(folder)
        if is_new and not os.path.isdir(Path(folder).absolute().parent):
            raise OutputError(f"The folder {Path(folder).parent} does not exist; create it first.")
        with explained(OutputError, "make the folder", folder, "check the path and the permissions"):
            Path(folder).mkdir(exist_ok=True)
        try:
            self._convert_all(inputs, outputs)
        finally:
            if is_new:
                with suppress(OSError):
                    Path(folder).rmdir()  # fails unless it is empty

    def _convert_all(self, inputs: Sequence[str], outputs: Sequence[str | None]) -> None:
        """Convert every input to its output, or into its own folder where that is None.

        An input that fails is reported, and the next one follows; at the end the process exits with code 1 if any has
        failed.
        """
        errors = console()
        done = 0
        failed = []
        try:
            for number, (path, output) in enumerate(zip(inputs, outputs, strict=True), 1):
                try:
                    self._convert(path, output, f"{number}/{len(inputs)} ")
                    done += 1
                except CompleteAlreadyError as already:
                    if self.messages.prints_text:
                        errors.print(sentence(str(already)))
                    done += 1
                except FpsboostError as error:
                    if self.messages.verbose:
                        say_traceback()
                    say_error(errors, error)
                    failed.append(path)
        except KeyboardInterrupt as stopped:
            stopped.add_note(f"{done} of {len(inputs)} inputs were converted.")
            raise
        if failed:
            names = literal(", ".join(failed))
            errors.print(f"[red]fpsboost:[/] {len(failed)} of {len(inputs)} inputs failed: {names}.")
            sys.exit(1)
        if self.messages.prints_text:
            errors.print(f"All {len(inputs)} inputs were converted.")


def plan_outputs(inputs: Sequence[str], folder: str) -> list[str]:
    """Choose an output path in a folder, which need not exist, for each input.

    A video keeps its name, and its suffix if that can be written; images go into a folder of their folder's name.
    Raises `OptionError` if the last argument is not a folder, or two inputs would get the same output.
    """
    if {folder, *inputs} & {*PIPES}:
        raise OptionError("A pipe is one clip; convert several inputs with names, into a folder.")
    is_file = os.path.exists(folder) or extension_of(folder) in (*OUTPUT_SUFFIXES, *IMAGE_SUFFIXES)
    # os.path.isdir, as pathlib's raises an exception for impossible names
    if (is_file and not os.path.isdir(folder)) or is_pattern(folder):
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
        # as many as a video shows, until the end of its last frame
        remarks.add("last-image", frames=frames_in, images=frames_out, expected=math.ceil(frames_in * multiple))


def check_ending(input: str, output: str) -> None:
    """Raise `OptionError` if a video gets an output that is a folder only because its name has no extension."""
    # all other inputs are images, or refused in their turn, as is an output that is there and no folder
    is_video = input in PIPES or (os.path.isfile(input) and extension_of(input) not in IMAGE_SUFFIXES)
    is_meant = output in PIPES or output.endswith(("/", "\\")) or os.path.lexists(output) or is_pattern(output)
    if output and is_video and not (Path(output).suffix or is_meant):
        ending = extension_of(input) if extension_of(input) in OUTPUT_SUFFIXES else ".mp4"
        raise OptionError(f"{output} has no extension; write {output}{ending}, or {output}/ for a folder of images.")
