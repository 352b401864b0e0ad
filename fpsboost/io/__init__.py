"""Sources and sinks of frames.

What any source and sink must do is in `fpsboost.contracts`. `fpsboost.io.opening` chooses an implementation by the
path, which names a video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``,
``shot_####.png``), or a pipe (``-``).
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from fpsboost.contracts import FrameSource

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.io.output import StreamInfo
    from fpsboost.media import FrameIndex


class DescribedSource(FrameSource, Protocol):
    """Contract: source that knows what its clip has beside the frames."""

    @property
    def stream_info(self) -> StreamInfo:
        """Streams, tags and files that a sink can keep besides the frames; may read the first frame."""


@runtime_checkable
class SeekableSource(Protocol):
    """Contract: source of a video file, in which it can seek, and whose frames it can list without decoding them."""

    frame_index: FrameIndex | None
    """List of the frames; None before `RandomAccess.frame_times` has made it, or if it cannot.

    That of another source of the same file may be set before.
    """

    @property
    def stopped_by(self) -> str | None:
        """Sentence about the first change, in the frames read so far, that a conversion refuses; None without one."""

    def first_time(self) -> Fraction:
        """Return the time of the clip's first frame, seconds."""

    def skip_to(self, time: Fraction) -> None:
        """Seek to a time, or as little before it as the source can; must be called before the first frame is read.

        All frames from that time on are the same as without seeking.
        """
