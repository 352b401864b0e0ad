"""Sources and sinks of frames.

What any source and sink must do is in `fpsboost.contracts`. `fpsboost.io.opening` chooses an implementation by the
path, which names a video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``,
``shot_####.png``), or a pipe (``-``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from fpsboost.contracts import RandomAccess

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.io.output import StreamInfo


class DescribedSource(RandomAccess, Protocol):
    """Contract: source that knows what its clip has beside the frames."""

    @property
    def stream_info(self) -> StreamInfo:
        """Streams, tags and files that a sink can keep besides the frames; may read the first frame."""
