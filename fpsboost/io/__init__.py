"""Sources and sinks of frames.

Two contracts, `FrameSource` and `FrameSink`, are those of the loop; see `fpsboost.contracts`. `fpsboost.io.opening`
chooses an implementation by the path, which names a video file, an animation, a folder of images, a pattern of images
(``shot_%04d.png``, ``shot_####.png``), or a pipe (``-``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from fractions import Fraction
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from fpsboost.contracts import FrameSource

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.io.output import StreamInfo
    from fpsboost.io.video.frame_index import FrameIndex


class DescribedSource(FrameSource, Protocol):
    """Contract: source that knows what its clip has beside the frames."""

    @property
    def stream_info(self) -> StreamInfo:
        """What a sink can keep besides the frames; may read the first frame."""


class ClosesOnExit(ABC):
    """Context manager that calls `close` on exit."""

    @abstractmethod
    def close(self) -> None:
        """Release all resources."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@runtime_checkable
class RandomAccess(Protocol):
    """Contract: source that knows when its frames are shown without decoding them, and can begin at any of them."""

    def frame_times(self) -> Sequence[Fraction] | None:
        """Return the times of all frames in order, seconds; None if only decoding tells. Before the first is read.

        They are exactly those that iterating yields: iterating raises `InputError` at a frame that has another time.
        """

    def begin_at(self, number: int) -> None:
        """Begin reading at a frame, counted from 0. Before the first is read.

        Frames are those of reading from the start, bit by bit; where that needs the frames before, they are decoded and
        dropped, and a remark says why. Raises `InputError`, here or while iterating, if there is no such frame.
        """


@runtime_checkable
class SharesIndex(Protocol):
    """Contract: source that reads a file to list its frames, and can take that list from another source of the file."""

    @property
    def frame_index(self) -> FrameIndex | None:
        """The list; None if there is none, or `RandomAccess.frame_times` was not called yet."""

    def take_index(self, index: FrameIndex) -> None:
        """Take the list of a source of the same file; must be called before `RandomAccess.frame_times`."""


@runtime_checkable
class Stoppable(Protocol):
    """Contract: source that may end where its clip changes in a way that a conversion refuses."""

    @property
    def stopped_by(self) -> str | None:
        """Sentence about the first such change among the frames read so far; None if there was none."""
