"""Options for how a conversion is run."""

from __future__ import annotations

from dataclasses import dataclass

from fpsboost.contracts import FrameWatcher, Observer
from fpsboost.errors import OptionError
from fpsboost.io.part import Part, parse_part
from fpsboost.io.side.options import SideOutputs
from fpsboost.memory import MemoryLimit, parse_memory
from fpsboost.options import option


@dataclass(frozen=True)
class RunOptions:
    """How a conversion is run; nothing of it shapes the frames.

    Parameters
    ----------
    overwrite : bool
        Replace an existing output.
    in_place : bool
        Write the frames that are made beside the images of the input; the output must not be given. Existing files are
        never changed.
    resume : bool
        Resume an earlier run of the same input and options that was stopped, after the frames that it finished; start
        anew if there is none.
    limit : MemoryLimit, optional
        Memory that may be used: a clip that needs more is refused before it is decoded. By default what is available.
    threads : int, optional
        Pairs of frames processed in parallel; by default as many as there are cores and memory for. Frames are the
        same with any number.
    chunk : Part, optional
        Make only this part of the output, in a folder of its own; see `fpsboost.join`.
    observer : Observer, optional
        Informed of the progress.
    watcher : FrameWatcher, optional
        Sees every frame as it is written.
    side : SideOutputs
        What is written beside the frames; nothing by default.

    Raises
    ------
    OptionError
        Side outputs are asked for of a part, or of a run that is to be resumed; or `chunk` and `in_place` are given.
    """

    overwrite: bool = option(False, "Replace an existing output.", short="y")
    in_place: bool = option(False, "Write into the folder of the input images; no OUT.")
    resume: bool = option(False, "Continue the same job where it was interrupted.")
    limit: MemoryLimit | None = option(
        None, "Refuse jobs above this: 8G; else the free memory.", flag="max-memory", parse=parse_memory
    )
    threads: int | None = option(None, "Pairs of frames in parallel; else one per core.")
    chunk: Part | None = option(None, "Convert part K of N; see fpsboost join.", metavar="K/N", parse=parse_part)
    observer: Observer | None = None
    watcher: FrameWatcher | None = None
    side: SideOutputs = SideOutputs()

    def __post_init__(self) -> None:
        if self.chunk is not None and self.in_place:
            raise OptionError(
                "`chunk` writes its part into a folder, which does not work with `in_place`; leave one of them out."
            )
        if self.chunk is not None and self.side.given:
            raise OptionError(f"`chunk` does not work with {' or '.join(self.side.given)}; leave one of them out.")
        if self.resume and self.side.given:
            raise OptionError(
                f"`resume` does not compute finished frames again, which {' and '.join(self.side.given)} would need; "
                "leave one of them out."
            )
