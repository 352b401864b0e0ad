"""Frames of other tools: from a folder, or from a command that writes one.

`docs/comparison.md` describes the possible content of such a folder, and how its images are matched.
"""

import os
import time
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from fpsboost.errors import InputError, explained
from fpsboost.evaluation.commands import run_command, split_command, write_frame
from fpsboost.evaluation.compared_methods import InterpolatedFrame, as_type_of
from fpsboost.evaluation.hidden_frames import Interval
from fpsboost.image import Image
from fpsboost.io.images.files import read_image
from fpsboost.io.images.source import find_images

UNKNOWN = float("nan")
"""Time of a tool that was not run here."""

PLACEHOLDERS = "{in}", "{out}"
"""Placeholders of a command for the folders of the shown frames, and of all."""


@dataclass(frozen=True)
class PeerFrames:
    """Frames of another tool, one image for each hidden frame, by its number; seconds are those per frame."""

    files: Mapping[int, Path]
    """Images by the numbers of the frames."""
    description: str
    """Command, or name of the folder."""
    seconds: float = UNKNOWN
    """Elapsed time per frame; NaN if unknown."""
    cpu_seconds: float = UNKNOWN
    """CPU time per frame; NaN if unknown."""
    any_time: ClassVar[bool] = False  # it was given frames without times

    def interpolate(
        self, intervals: Iterable[Interval], wanted: Container[int] | None = None
    ) -> Iterator[InterpolatedFrame]:
        """Yield the hidden frames; see `ComparedMethod.interpolate`.

        Raises `InputError` if an image cannot be read, or has another size.
        """
        for interval in intervals:
            for hidden in interval.hidden:
                if wanted is None or hidden.number in wanted:
                    image = read_like(self.files[hidden.number], hidden.truth)
                    yield InterpolatedFrame(hidden.number, image, self.seconds, self.cpu_seconds)

    def describe(self) -> str:
        return self.description


def find_frames(name: str, folder: Path, intervals: Iterable[Interval]) -> PeerFrames:
    """Match the images of a folder to all hidden frames of a clip, by the rules in `docs/comparison.md`.

    Raises `InputError` if the folder cannot be read, or an image is missing. `name` names the tool in messages.
    """
    with explained(InputError, "read", folder, "name a folder of images"):
        images = find_images(str(folder))
    files = images.files
    own = images.numbers
    hidden: list[int] = []
    shown: list[int] = []
    for interval in intervals:
        hidden += [each.number for each in interval.hidden]
        shown += [interval.shown0.position.number, interval.shown1.position.number]
        skip = len(interval.hidden)
    first = shown[0]
    last = shown[-1]
    steps = np.diff(own).tolist()
    is_even = len(set(steps)) <= 1
    numbers: Sequence[int] = own
    if is_even and last - first < len(files) <= last - first + 1 + skip:
        numbers = range(first, first + len(files))
    elif own[:1] in ([0], [1]) and set(steps) == {1} and len(files) > last:
        numbers = range(len(files))
    elif len(files) == len(hidden) and (is_even or steps == np.diff(hidden).tolist()):
        numbers = hidden
    paths = dict(zip(numbers, files, strict=False))
    missing = [number for number in hidden if number not in paths]
    if missing:
        raise InputError(
            f"{folder} has {len(files)} images, but none for frame {missing[0]}; {name} must give the whole "
            f"sequence ({last - first + 1} images), the hidden frames alone ({len(hidden)}), or images numbered "
            "like the frames of the clip, counted from 0."
        )
    return PeerFrames(paths, f"images of {folder}")


def run_peer(name: str, command: str, intervals: Iterable[Interval], scratch: Path) -> PeerFrames:
    """Let another program interpolate the hidden frames.

    Parameters
    ----------
    name : str
        Name of the tool.
    command : str
        Command with ``{in}`` and ``{out}`` for folders, and optionally ``{factor}`` and ``{fps}``; see
        `docs/comparison.md`.
    intervals : iterable of Interval
        Intervals of the clip.
    scratch : Path
        Empty folder, which must exist as long as the frames are used.

    Raises
    ------
    InputError
        The command fails, or writes too few or too many images.
    OptionError
        The command cannot be parsed.
    """
    words = split_command("peer", name, command, PLACEHOLDERS)
    folders = scratch / "in", scratch / "out"
    for folder in folders:
        folder.mkdir()
    places, count, factor, rate = _write_shown(intervals, folders[0])
    values = {"{factor}": factor, "{fps}": f"{rate:.10g}", **dict(zip(PLACEHOLDERS, folders, strict=True))}
    begin = time.perf_counter()
    begin_cpu = _seconds_of_children()
    _, last_line = run_command("peer", name, words, values)
    seconds = time.perf_counter() - begin
    cpu_seconds = _seconds_of_children() - begin_cpu
    images = find_images(str(folders[1])).files if any(folders[1].iterdir()) else []
    least = (count - 1) * factor + 1
    if not least <= len(images) <= count * factor:
        raise InputError(
            f"The peer {name} made {len(images)} images of {count}, not {least} to {count * factor}; its command must "
            "write all frames, the shown ones too, as images into {out}"
            f"{last_line and f' (it printed: {last_line})'}."
        )
    files = {number: images[place] for number, place in places.items()}
    return PeerFrames(files, command, seconds / len(files), cpu_seconds / len(files))


def _write_shown(intervals: Iterable[Interval], folder: Path) -> tuple[dict[int, int], int, int, float]:
    """Write the shown frames, and return the output that is expected of the other program.

    That is the positions of the hidden frames in its output by their numbers, the number of shown frames, that of
    output frames for each of them, and the shown frames per second.
    """
    places: dict[int, int] = {}
    seconds = 0.0
    for index, interval in enumerate(intervals):
        factor = len(interval.hidden) + 1
        if index == 0:
            write_frame(folder, 0, interval.shown0.frame.array)
        write_frame(folder, index + 1, interval.shown1.frame.array)
        places |= {hidden.number: index * factor + k for k, hidden in enumerate(interval.hidden, start=1)}
        seconds += float(interval.shown1.time - interval.shown0.time)
    return places, index + 2, factor, (index + 1) / seconds


def _seconds_of_children() -> float:
    """Return the CPU time of all child processes that have ended, seconds."""
    times = os.times()
    return times.children_user + times.children_system


def read_like(path: Path, like: Image) -> Image:
    """Return an image `as_type_of` the clip's frames; raises `InputError` if it has another size."""
    image = read_image(path)
    if image.shape[:2] != like.shape[:2]:
        height, width = image.shape[:2]
        clip_height, clip_width = like.shape[:2]
        raise InputError(
            f"{path} has {width}x{height} pixels, and the clip has {clip_width}x{clip_height}; they must be one size."
        )
    return as_type_of(image, like)
