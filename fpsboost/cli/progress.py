"""Progress display of a conversion, and its summary at the end."""

from __future__ import annotations

import gc
import json
import sys
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any, Self

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

from fpsboost.cli.messages import console, literal, sentence
from fpsboost.cli.options import MessageOptions, in_flags
from fpsboost.kernels.compiling import told_of_compiling
from fpsboost.timing.position import format_time
from fpsboost.version import __version__

if TYPE_CHECKING:
    from fpsboost.contracts import Summary
    from fpsboost.frame import ClipInfo
    from fpsboost.interpolator import Interpolator


class FramesPerSecondColumn(ProgressColumn):
    """Progress column with the output frames per second so far."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} frames/s", style="progress.data.speed")


def collect_from_here_on() -> None:
    """Have Python look for cycles among objects again, but not among what was imported and compiled, as that stays."""
    gc.freeze()
    gc.enable()


class Reporter(ExitStack):
    """Observer that shows a conversion: a bar on a terminal, nothing when piped, a summary at the end."""

    def __init__(self, output: str, *, quiet: bool, verbose: bool, announced: list[str] | None = None) -> None:
        super().__init__()
        self._announced = [] if announced is None else announced
        self._console = console(quiet=quiet)
        self._output, self._verbose = output, verbose
        self._info: ClipInfo | None = None
        self._task: TaskID | None = None
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed}/{task.fields[frames]}"),
            FramesPerSecondColumn(),
            TimeRemainingColumn(compact=True),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )

    def __enter__(self) -> Self:
        self.enter_context(self._progress)
        return self

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        self._info = info
        if self._verbose:
            count = "an unknown number of" if info.frame_count is None else info.frame_count
            self._say(f"{info.name}: {info.width}x{info.height}, {count} frames at {readable(info.rate)} fps")
        self.enter_context(told_of_compiling(self._say_compiling))
        self._task = self._progress.add_task(
            literal(self._output), total=expected_frames, start=False, frames=expected_frames or "?"
        )

    def ready(self) -> None:
        collect_from_here_on()
        if self._task is not None:
            self._progress.start_task(self._task)

    def wrote(self, summary: Summary) -> None:
        if self._task is not None:
            self._progress.update(self._task, completed=summary.frames_out)

    def say_settings(self, method: str, interpolator: Interpolator) -> None:
        """Print every option in use, if --verbose is given."""
        if self._verbose:
            self._say(f"fpsboost {__version__}, method {method}")
            for part in (interpolator.estimator, interpolator.synthesizer, interpolator.cuts or "no scene cuts"):
                self._say(f"  {part}")

    def say_summary(self, summary: Summary) -> None:
        """Print what was done, and every remark."""
        assert self._info is not None, "a summary comes after opening"
        frames = f"{summary.frames_in} -> {summary.frames_out} frames"
        if summary.duplicates:
            frames += f", {summary.duplicates} duplicate frame{'s' if summary.duplicates > 1 else ''}"
        if summary.scene_cuts:
            frames += f", {summary.scene_cuts} scene cut{'s' if summary.scene_cuts > 1 else ''}"
        if summary.completed_frames:
            frames += f", {summary.completed_frames} of which were there already"
        if self._verbose and summary.search_radii:
            least, largest = min(summary.search_radii), max(summary.search_radii)
            self._say(f"Search radius: {least if least == largest else f'{least} to {largest}'} pixels.")
        for text in filter(None, (summary.details, summary.utilisation) if self._verbose else ()):
            self._say(text)
        lowest, where = summary.lowest_match, ""
        if lowest is not None and lowest.match_score < 1:
            file = f", {summary.lowest_match_file}" if summary.lowest_match_file else ""
            where = f", least certain at {format_time(lowest.time)} (frame {lowest.number}{file})"
        self._say(f"{self._output}: {frames} in {summary.seconds:.1f} s ({_speed(summary):.1f} frames/s){where}")
        for remark in summary.remarks:
            self._say(f"Note: {remark}")

    def _say_compiling(self) -> None:
        text = "Compiling for this machine, once; later runs start at once."
        if text not in self._announced:
            self._announced.append(text)
            self._say(text)

    def _say(self, text: str) -> None:
        self._console.print(sentence(text))


class JsonReporter(ExitStack):
    """Observer that prints a conversion as JSON for the program that has started it, one object a line."""

    def __init__(self, output: str) -> None:
        super().__init__()
        self._output, self._frames = output, 0
        self._expected: int | None = None

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        self._expected = expected_frames
        self.enter_context(told_of_compiling(partial(self._print, "compiling")))
        self._print("opened")

    def ready(self) -> None:
        collect_from_here_on()
        self._print("ready")

    def wrote(self, summary: Summary) -> None:
        self._frames = summary.frames_out
        self._print("converting", fps=_speed(summary))

    def say_settings(self, method: str, interpolator: Interpolator) -> None:
        """Do nothing: the program knows what it has asked for."""

    def say_summary(self, summary: Summary) -> None:
        """Print what was done, and every remark."""
        self._frames = summary.frames_out
        counts = {
            "frames_in": summary.frames_in,
            "frames_made": summary.frames_made,
            "duplicates": summary.duplicates,
            "scene_cuts": summary.scene_cuts,
            "seconds": round(summary.seconds, 3),
            "least_certain": _least_certain(summary),
        }
        remarks = [in_flags(remark) for remark in summary.remarks]
        self._print("done", fps=_speed(summary), done=True, output=self._output, **counts, remarks=remarks)

    def _print(self, stage: str, fps: float | None = None, **more: Any) -> None:
        print_object(frame=self._frames, frames=self._expected, fps=fps, stage=stage, **more)


def reporter_of(
    output: str, messages: MessageOptions, place: str = "", announced: list[str] | None = None
) -> Reporter | JsonReporter:
    """Return the observer that the options ask for; `place` precedes the output; what was `announced` is not again."""
    if messages.progress == "json":
        return JsonReporter(output)
    return Reporter(place + output, quiet=messages.quiet, verbose=messages.verbose, announced=announced)


def print_object(**values: Any) -> None:
    """Print a JSON object on one line of standard error."""
    sys.stderr.write(json.dumps(values) + "\n")
    sys.stderr.flush()


def _least_certain(summary: Summary) -> dict[str, float] | None:
    """Return where the result is least certain; None if nothing was made between two frames of a scene."""
    lowest = summary.lowest_match
    if lowest is None:
        return None
    time, match_score = round(float(lowest.time), 6), round(lowest.match_score, 4)
    return {"frame": lowest.number, "time": time, "match_score": match_score}


def _speed(summary: Summary) -> float:
    """Return the frames per second of this run."""
    return round((summary.frames_out - summary.completed_frames) / max(summary.seconds, 1e-9), 2)


def readable(number: Any) -> str:
    """Return a rate as people write it: 24, 23.976."""
    return f"{float(number):.3f}".rstrip("0").rstrip(".")
