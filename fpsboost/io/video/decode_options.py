"""How a source is read, as far as its user decides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from fpsboost.errors import OptionError, check_choice

SizeChange = Literal["stop", "scale"]
Decoder = Literal["ffmpeg", "opencv"]


@dataclass(frozen=True)
class DecodeOptions:
    """How a source is read.

    Parameters
    ----------
    stream : int, optional
        Number of the video stream in its file, as `fpsboost probe` prints it; by default the one that FFmpeg takes for
        the best.
    deinterlace : bool
        Make a frame of each field before anything else, which doubles the frame rate; also of frames that are not
        flagged as interlaced.
    size_change : {'stop', 'scale'}
        Where pictures change their size or pixel format: stop, or make them all like the first one.
    decoder : {'ffmpeg', 'opencv'}
        What reads videos: PyAV's FFmpeg, or the OpenCV that is installed, which may open what that cannot (cameras,
        GStreamer pipelines) but gives 8-bit pictures alone.

    Raises
    ------
    OptionError
        A value can never work.
    """

    stream: int | None = None
    deinterlace: bool = False
    size_change: SizeChange = "stop"
    decoder: Decoder = "ffmpeg"

    def __post_init__(self) -> None:
        check_choice("--size-change", self.size_change, get_args(SizeChange))
        check_choice("--decoder", self.decoder, get_args(Decoder))
        if self.stream is not None and self.stream < 0:
            raise OptionError(f"--stream must be the number of a stream, 0 or more, not {self.stream}.")

    @property
    def given(self) -> list[str]:
        """The options that differ from the defaults, as the command line calls them."""
        values = {
            "--stream": self.stream is not None,
            "--deinterlace": self.deinterlace,
            "--size-change": self.size_change != "stop",
            "--decoder": self.decoder != "ffmpeg",
        }
        return [option for option, is_given in values.items() if is_given]
