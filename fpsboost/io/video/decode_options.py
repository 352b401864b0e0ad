"""Options of the user for reading a source."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, get_args

from fpsboost.errors import OptionError, check_choice
from fpsboost.io.trim import Trim

SizeChange = Literal["stop", "scale"]
Decoder = Literal["ffmpeg", "opencv"]


@dataclass(frozen=True)
class DecodeOptions:
    """Options for reading a source.

    Parameters
    ----------
    trim : Trim
        Which part of the input is read; all of it unless told.
    input_fps : Fraction or int, optional
        Frames per second of input images.
    stream : int, optional
        Number of the video stream in its file, as `fpsboost probe` prints it; by default the one that FFmpeg considers
        the best.
    deinterlace : bool
        Make a frame of each field before any other step, which doubles the frame rate; this includes frames that are
        not flagged as interlaced.
    size_change : {'stop', 'scale'}
        If pictures change their size or pixel format: stop, or convert all of them to the first one's.
    decoder : {'ffmpeg', 'opencv'}
        Library that reads videos: PyAV's FFmpeg, or the installed OpenCV, which may open what FFmpeg cannot (cameras,
        GStreamer pipelines) but gives 8-bit pictures only.

    Raises
    ------
    OptionError
        A value is never valid.
    """

    trim: Trim = Trim()
    input_fps: Fraction | int | None = None
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
        """Command-line names of the options that differ from the defaults."""
        values = {
            "--stream": self.stream is not None,
            "--deinterlace": self.deinterlace,
            "--size-change": self.size_change != "stop",
            "--decoder": self.decoder != "ffmpeg",
        }
        return [option for option, is_given in values.items() if is_given]
