"""Options for how a conversion is run, and which part of it."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fpsboost.contracts import FrameWatcher, Observer, SilentObserver, Summary
from fpsboost.errors import CancelledError, OptionError
from fpsboost.io.side.options import SideOutputs
from fpsboost.media import ClipInfo
from fpsboost.memory import MemoryLimit, parse_memory
from fpsboost.options import Checked, PathName, PositiveInt, option

MAX_PARTS = 9999

Progress = Callable[[int, int | None], object]
"""Function that is told how many frames are done, and how many there are, None if that is unknown."""


@dataclass(frozen=True)
class Part(Checked):
    """One of the parts that a conversion is cut into: its number, counted from 1, and how many there are."""

    number: int
    count: int

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.number <= self.count <= MAX_PARTS:
            raise OptionError(f"`chunk={self}` does not exist; parts are numbered from 1 to N, at most {MAX_PARTS}.")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def folder(self, output: PathName) -> Path:
        """Return where this part of an output is written: beside it, in a folder of its name with ``.parts`` behind it.

        Examples
        --------
        >>> Part(3, 8).folder("films/out.mp4").as_posix()
        'films/out.mp4.parts/0003-of-0008'
        """
        return parts_folder(output) / f"{self.number:04d}-of-{self.count:04d}"


def parts_folder(output: PathName) -> Path:
    """Return the folder that holds the parts of an output."""
    whole = Path(output)
    return whole.parent / f"{whole.name}.parts"


def count_parts(folder: Path) -> int | None:
    """Return the number of parts of the job whose parts, finished or not, are in a folder; None if there are none."""
    names = (re.search(r"\d{4}-of-(\d{4})\b", path.name) for path in folder.glob("*"))
    return max((int(name[1]) for name in names if name), default=None)


def parse_part(text: str, option: str = "`chunk`") -> Part:
    """Parse the number of a part and how many there are; messages name it by `option`."""
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
    if match is None:
        raise OptionError(f"{option} {text!r} is not a part; write it like 3/8 for the third of eight.")
    return Part(int(match[1]), int(match[2]))


@dataclass(frozen=True)
class RunOptions(Checked):
    """How a conversion is run; its frames are the same with any of these options.

    Parameters
    ----------
    overwrite : bool
        Replace an existing output.
    in_place : bool
        Write interpolated frames into the folder of the input images; `output` must be None. Existing files are never
        changed.
    resume : bool
        Resume an earlier run of the same input and options that was stopped, after the frames that it finished; start
        anew if there is none.
    limit : MemoryLimit, optional
        Memory that may be used: a clip that needs more is refused before it is decoded. By default what is available.
    threads : int, optional
        Pairs of frames processed in parallel; by default as many as there are cores and memory for. Frames are the
        same with any number.
    chunk : Part, optional
        Convert only this part of the output, into a folder of its own; see `fpsboost.join`.
    observer : Observer, optional
        Informed of the progress.
    progress : callable, optional
        Called after each frame with the number of frames that are done, and the number of all, which is None if the
        input does not say it.
    cancel : callable, optional
        Called after each frame; the conversion ends with `CancelledError` if it returns a true value, as
        ``threading.Event().is_set`` does.
    watcher : FrameWatcher, optional
        Sees every frame as it is written.
    side : SideOutputs
        What is written beside the frames; nothing by default.

    Raises
    ------
    OptionError
        Options cannot be combined; see `fpsboost.conflicts`.
    """

    overwrite: bool = option(False, "Replace an existing output.", short="y")
    in_place: bool = option(False, "Write into the folder of the input images; no OUT.")
    resume: bool = option(False, "Continue the same job where it was interrupted.")
    limit: MemoryLimit | None = option(
        None, "Refuse jobs above this: 8G; else the free memory.", flag="max-memory", parse=parse_memory
    )
    threads: PositiveInt | None = option(None, "Pairs of frames in parallel; else one per core.")
    chunk: Part | None = option(None, "Convert part K of N; see fpsboost join.", metavar="K/N", parse=parse_part)
    observer: Observer | None = None
    progress: Progress | None = None
    cancel: Callable[[], object] | None = None
    watcher: FrameWatcher | None = None
    side: SideOutputs = SideOutputs()


class RunObserver:
    """Observer that calls what the options of a run have for it: `observer`, `progress` and `cancel`."""

    def __init__(self, run: RunOptions) -> None:
        self._run = run
        self._observer = run.observer or SilentObserver()
        self._expected: int | None = None

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """See `Observer`."""
        self._expected = expected_frames
        self._observer.opened(info, expected_frames)

    def ready(self) -> None:
        """See `Observer`."""
        self._observer.ready()

    def wrote(self, summary: Summary) -> None:
        """See `Observer`; raises `CancelledError` if the run is to end."""
        self._observer.wrote(summary)
        if self._run.progress is not None:
            self._run.progress(summary.frames_out, self._expected)
        if self._run.cancel is not None and self._run.cancel():
            raise CancelledError("The conversion was cancelled.")
