"""How a video file is read."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal


@dataclass(frozen=True)
class Reading:
    """How a video file is read.

    Parameters
    ----------
    stream : int, optional
        Number of the video stream in its file; by default the one that FFmpeg considers the best.
    input_fps : Fraction, optional
        Frames per second of a raw stream, which says none or a wrong one.
    deinterlace : bool
        Make two pictures of each, one per field.
    size_change : {'stop', 'scale'}
        Where pictures change their size, pixel format or pixel shape, or to or from HDR: raise `InputError`, or make
        all of them like the first one.
    keeps_alpha : bool
        Decode alpha that is stored beside the pictures; otherwise alpha is left out, with a remark.
    allow_playlists : bool
        Read playlists, and the files that they name.
    force_colours : bool
        Take pictures of Dolby Vision that are no ordinary video for ordinary ones, in wrong colours.
    end : callable, optional
        Returns the end of the part that is read, seconds, for a frame rate; what is encrypted behind it is no error.
    threads : int
        Threads of the decoder, each of which holds pictures of its own.
    check_size : callable, optional
        Called with the name of the file, and width and height of its pictures, before they are decoded; it may raise.
    """

    stream: int | None = None
    input_fps: Fraction | None = None
    deinterlace: bool = False
    size_change: Literal["stop", "scale"] = "stop"
    keeps_alpha: bool = True
    allow_playlists: bool = False
    force_colours: bool = False
    end: Callable[[Fraction], Fraction] | None = None
    threads: int = 1
    check_size: Callable[[str, int, int], None] = lambda name, width, height: None
