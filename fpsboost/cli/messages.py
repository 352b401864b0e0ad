"""Messages of the command line, with control characters of foreign texts escaped, and progress."""

from __future__ import annotations

import gc
import json
import os
import sys
import traceback
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from contextlib import ExitStack
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.table import Column, Table
from rich.text import Text

import fpsboost
from fpsboost.cli.flags import in_flags
from fpsboost.cli.options import MessageOptions
from fpsboost.errors import notes_of, rounded
from fpsboost.media import Remark, counted
from fpsboost.timing.options import readable
from fpsboost.timing.position import as_ranges, format_time

WIDTHS = range(20, 2001)
"""Columns of a terminal in which text is laid out; with none, Rich shows nothing and Cyclopts never ends."""
CONTROL_CATEGORIES = {"Cc", "Cs", "Zl", "Zp"}
"""Unicode categories of characters that move the cursor, colour the screen, or cannot be encoded."""

BIDI_CONTROLS = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that change the writing direction, so that one name reads like another."""


def keep_columns_readable() -> None:
    """Make Rich lay out text in a readable width, whatever width the terminal and the environment report."""
    width = Console().width
    if width not in WIDTHS:
        os.environ["COLUMNS"] = str(min(max(width, WIDTHS[0]), WIDTHS[-1]))


def console(*, quiet: bool = False) -> Console:
    """Return a console on standard error that prints each message on one line."""
    return Console(stderr=True, highlight=False, soft_wrap=True, quiet=quiet)


def literal(text: str) -> str:
    """Return a text escaped so that Rich prints it as it is, with control characters such as ``\\x1b`` spelled out."""
    return escape(_escape_controls(text))


def sentence(text: str) -> str:
    """Return a message of the library with flags in place of the options that it names, escaped like `literal`."""
    return literal(in_flags(text))


def as_objects(remarks: Iterable[Remark]) -> list[dict[str, object]]:
    """Return remarks as objects for JSON, with flags in place of the options that sentences name."""
    return [{**remark.data, "sentence": in_flags(remark)} for remark in remarks]


def fact_table(facts: Mapping[str, str], title: str | None = None) -> Table:
    """Return a table of names and values; long values are folded.

    Parameters
    ----------
    facts : Mapping
        Values by name, in Rich's markup: pass foreign text through `literal`.
    title : str, optional
        Title above the table, in Rich's markup.
    """
    columns = Column(style="dim", no_wrap=True), Column(overflow="fold")
    table = Table(*columns, box=None, pad_edge=False, show_header=False, title=title, title_justify="left")
    for name, value in facts.items():
        table.add_row(name, value)
    return table


def say_error(errors: Console, error: BaseException) -> None:
    """Print an error and its notes on one line, with flags in place of the options that they name."""
    errors.print(f"[red]fpsboost:[/] {sentence(f'{error} {notes_of(error)}'.strip())}")


def say_traceback() -> None:
    """Print the traceback of the exception that is being handled."""
    sys.stderr.write(_escape_controls(traceback.format_exc(), kept="\n"))


def _escape_controls(text: str, kept: Collection[str] = ()) -> str:
    """Return a text with control characters as Python escapes, but for those that are `kept`."""
    escaped = {letter for letter in text if unicodedata.category(letter) in CONTROL_CATEGORIES} | BIDI_CONTROLS
    return "".join(ascii(letter)[1:-1] if letter in escaped and letter not in kept else letter for letter in text)


class FramesPerSecondColumn(ProgressColumn):
    """Progress column with the output frames per second so far."""

    def render(self, task: Task) -> Text:
        """Return the speed of a task as text; empty before it is known."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} frames/s", style="progress.data.speed")


def collect_from_here_on() -> None:
    """Enable Python's garbage collector again, with all imported objects exempt from it.

    With OpenImageIO loaded nothing is exempt, because it must be torn down at the end of the process: it prints a list
    of objects that are left.
    """
    if "OpenImageIO" not in sys.modules:
        gc.freeze()
    gc.enable()


class Reporter(ExitStack):
    """Observer that shows a conversion as text: a progress bar on a terminal, and a summary at the end.

    Parameters
    ----------
    output : str
        The output in messages.
    quiet : bool
        Print nothing.
    verbose : bool
        Also print properties of the clip, and all options in use.
    """

    def __init__(self, output: str, *, quiet: bool, verbose: bool) -> None:
        super().__init__()
        self._console = console(quiet=quiet)
        self._output = output
        self._verbose = verbose
        self._progress = self.enter_context(
            Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed}/{task.fields[frames]}"),
                FramesPerSecondColumn(),
                TimeRemainingColumn(compact=True),
                console=self._console,
                transient=True,
                disable=quiet or not self._console.is_terminal,
            )
        )
        self._task = self._progress.add_task(literal(output), start=False, total=None, visible=False)

    def opened(self, info: fpsboost.ClipInfo, expected_frames: int | None) -> None:
        """Print the properties of the clip, if verbose, and prepare the bar for `expected_frames`, None if unknown."""
        if self._verbose:
            count = "an unknown number of" if info.frame_count is None else info.frame_count
            self._say(f"{info.name}: {info.width}x{info.height}, {count} frames at {readable(info.rate)} fps")
        self._progress.update(self._task, total=expected_frames, frames=expected_frames or "?", visible=True)

    def ready(self) -> None:
        """Start the time of the bar, and the garbage collector."""
        collect_from_here_on()
        self._progress.start_task(self._task)

    def wrote(self, summary: fpsboost.Summary) -> None:
        """Advance the bar to the number of frames written."""
        self._progress.update(self._task, completed=summary.frames_out)

    def say_settings(self, method: str, interpolator: fpsboost.Interpolator) -> None:
        """Print the method and every option in use, if verbose."""
        if self._verbose:
            self._say(f"fpsboost {fpsboost.__version__}, method {method}")
            for part in (interpolator.estimator, interpolator.synthesizer, interpolator.cuts or "no scene cuts"):
                self._say(f"  {part}")

    def say_summary(self, summary: fpsboost.Summary, *, in_place: bool = False) -> None:
        """Print the counts of frames, the speed, the least certain frame and every remark.

        With `in_place`, also the number of images that were added.
        """
        frames = f"{summary.frames_in} -> {counted(summary.frames_out, 'frame')}"
        frames += f", {summary.frames_out - summary.frames_in} added" * in_place
        for count, what in ((summary.duplicates, "duplicate frame"), (summary.scene_cuts, "scene cut")):
            frames += f", {counted(count, what)}" if count else ""
        frames += f", {len(summary.replaced)} replaced" if summary.replaced else ""
        frames += f", {summary.completed_frames} of which were there already" if summary.completed_frames else ""
        if self._verbose:
            if summary.search_radii:
                least = min(summary.search_radii)
                largest = max(summary.search_radii)
                self._say(f"Search radius: {least if least == largest else f'{least} to {largest}'} pixels.")
            if summary.details:
                self._say(summary.details)
        lowest = summary.lowest_match
        where = ""
        if lowest is not None and lowest.match_score < 1:
            file = f", {summary.lowest_match_file}" if summary.lowest_match_file else ""
            # in milliseconds, the time may lie in the frame before, and players would show that
            time = format_time(lowest.time, decimals=6)
            where = (
                f", least certain at frame {lowest.number} of the output (counted from 0{file}, {time} after the first)"
            )
        self._say(f"{self._output}: {frames} in {summary.seconds:.1f} s ({_speed(summary):.1f} frames/s){where}")
        if summary.unsure_frames:
            share = rounded(100 * summary.unsure_pixels / summary.unsure_frames, 2)
            self._say(
                f"Unsure: {share} % of the pixels of {counted(summary.unsure_frames, 'frame')}, "
                "where motion is not used."
            )
        if summary.replaced:
            self._say(f"Replaced: {as_ranges(summary.replaced)}.")
        for remark in summary.remarks:
            self._say(f"Note: {remark}")

    def _say(self, text: str) -> None:
        """Print a message of the library on one line."""
        self._console.print(sentence(text))


class JsonReporter(ExitStack):
    """Observer that prints a conversion as JSON objects, one a line, for the program that has started it.

    Every object has the keys ``frame``, ``frames``, ``fps`` and ``stage``; see `print_object`.

    Parameters
    ----------
    output : str
        Path of the output, for the last object.
    """

    def __init__(self, output: str) -> None:
        super().__init__()
        self._output = output
        self._frames = 0
        self._expected: int | None = None
        self.push(self._ended)

    def opened(self, info: fpsboost.ClipInfo, expected_frames: int | None) -> None:
        """Print that source and target are open, with the expected number of frames."""
        self._expected = expected_frames
        self._print("opened")

    def ready(self) -> None:
        """Print that the first frame comes next, and start the garbage collector."""
        collect_from_here_on()
        self._print("ready")

    def wrote(self, summary: fpsboost.Summary) -> None:
        """Print the number of frames written and the speed."""
        self._frames = summary.frames_out
        self._print("converting", fps=_speed(summary))

    def say_settings(self, method: str, interpolator: fpsboost.Interpolator) -> None:
        """Do nothing: the calling program has set the options."""

    def say_summary(self, summary: fpsboost.Summary, *, in_place: bool = False) -> None:
        """Print the counts and remarks as the last object.

        ``least_certain`` is null if nothing was interpolated between two frames of a scene.
        """
        self._frames = summary.frames_out
        lowest = summary.lowest_match
        self._print(
            "done",
            fps=_speed(summary),
            done=True,
            output=self._output,
            frames_in=summary.frames_in,
            frames_made=summary.frames_made,
            duplicates=summary.duplicates,
            replaced=summary.replaced,
            unsure_frames=summary.unsure_frames,
            unsure_pixels=round(summary.unsure_pixels, 4),
            scene_cuts=summary.scene_cuts,
            seconds=round(summary.seconds, 3),
            least_certain=lowest
            and {
                "frame": lowest.number,
                "time": round(float(lowest.time), 6),
                "match_score": round(lowest.match_score, 4),
            },
            remarks=as_objects(summary.remarks),
        )

    def _ended(self, kind: object, error: object, trace: object) -> None:
        """If the run has ended early, print the number of frames that the next one need not compute."""
        for note in getattr(error, "__notes__", ()):
            if isinstance(note, Remark) and note.kind == "frames-finished":
                self._print("stopped", finished=note.values["finished"])

    def _print(self, stage: str, fps: float | None = None, **more: Any) -> None:
        """Print an object with the state of the conversion and further values."""
        print_object(frame=self._frames, frames=self._expected, fps=fps, stage=stage, **more)


def reporter_of(output: str, messages: MessageOptions, place: str = "") -> Reporter | JsonReporter:
    """Return the observer that the options ask for; `place`, such as ``2/5 ``, precedes the output in texts."""
    if messages.progress == "json":
        return JsonReporter(output)
    return Reporter(place + output, quiet=messages.quiet, verbose=messages.verbose)


def print_object(**values: Any) -> None:
    """Print a JSON object on one line of standard error."""
    sys.stderr.write(json.dumps(values, default=str) + "\n")
    sys.stderr.flush()


def _speed(summary: fpsboost.Summary) -> float:
    """Return the output frames per second of this run, without those of an earlier one."""
    return round((summary.frames_out - summary.completed_frames) / max(summary.seconds, 1e-9), 2)
