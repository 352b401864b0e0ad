"""Plain data from sources to sinks: what any clip has beside its frames, and what is to be written of it."""

from dataclasses import dataclass, field
from fractions import Fraction

from fpsboost import media
from fpsboost.errors import OutputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import view
from fpsboost.io.images.sequence import NumberedImages


@dataclass(frozen=True)
class StreamInfo(media.StreamInfo):
    """Everything that a clip has beside its frames, for the sink: of video, images or an animation."""

    images: NumberedImages | None = None
    """Files of the source, whose names and metadata the output can follow; None unless it is images."""
    plays: int = 0
    """Number of times that an animation is shown; 0 for ever."""

    @property
    def streams(self) -> list[media.StreamFacts]:
        """All streams of a video file; none of other clips."""
        return [] if self.video is None else media.list_streams(self.video)


@dataclass(frozen=True)
class Output(media.Output):
    """Output, as a sink needs it; its path may also be an animation, a folder, a pattern of images, or ``-``."""

    stream: StreamInfo = field(default_factory=StreamInfo)
    """Streams, tags and files of the source."""
    factor: Fraction | None = None
    """Frames written per frame of the source, for the numbers of images; numbered one by one without it."""
    in_place: bool = False
    """Write images beside those of the source."""


def check_frame_size(frame: Frame, info: ClipInfo, name: str) -> None:
    """Raise `OutputError` if a frame does not have the size of the clip; the message calls the output `name`."""
    if frame.image.shape[:2] != (info.height, info.width):
        raise OutputError(
            f"{name} is {info.width}x{info.height} and cannot take a frame of {view(frame.image).describe()}; make all "
            "frames one size first."
        )
