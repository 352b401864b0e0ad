"""Options of the user for reading a source."""

import os
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Literal, Self

from fpsboost.options import Checked, PathName, Range, Rate, given_fields, option
from fpsboost.timing.position import Trim
from fpsboost.timing.schedule import parse_number, parse_rate

SizeChange = Literal["stop", "scale"]
Decoder = Literal["ffmpeg", "opencv"]
View = Literal["none", "srgb"]
OWN = "own"
"""Name of the guide of damaged frames: themselves."""


@dataclass(frozen=True)
class DecodeOptions(Checked):
    """Options for reading a source.

    Parameters
    ----------
    trim : Trim
        Part of the input that is read; the whole input by default.
    input_fps : Fraction, int, float or str, optional
        Frames per second of input images, or of a raw stream (``.264``, ``.m2v``, ``.obu``), which says none or a wrong
        one. Other videos have times of their own.
    stream : int, optional
        Number of the video stream in its file, as `fpsboost probe` prints it; by default the one that FFmpeg considers
        the best.
    deinterlace : bool
        Make a frame of each field before any other step, which doubles the frame rate; this includes frames that are
        not flagged as interlaced.
    size_change : {'stop', 'scale'}
        If pictures change their size, pixel format or pixel shape, or are HDR and SDR: stop, or make all of them like
        the first one, with black beside those of another shape; the colours of HDR are not converted.
    allow_playlists : bool
        Read playlists (.m3u8, scripts of FFmpeg's concat), and whatever other files and addresses they name, keys of
        encrypted segments among them.
    force_colours : bool
        Take pictures of Dolby Vision that are no ordinary video (profile 5) for ordinary ones, in wrong colours.
    decoder : {'ffmpeg', 'opencv'}
        Library that reads videos: PyAV's FFmpeg, or the installed OpenCV, which may open what FFmpeg cannot (cameras,
        GStreamer pipelines) but gives 8-bit pictures only.
    passes : str, optional
        Layers of OpenEXR images that are made beside the picture, in OpenEXR images: ``all``, ``beauty`` for the
        picture alone, or their names with commas between them. By default all, or the picture alone where the output
        cannot hold more.
    view : {'none', 'srgb'}
        View transform of OpenEXR images for previews as video or animation: numbers as they are, or sRGB's curve, with
        white at 1.
    guide : str or os.PathLike, optional
        Guide of the frames that are made: a cheap clip of the same, which shows where everything is. Numbered images
        for images go by the numbers of the output; anything else goes by time. ``own`` takes the damaged frames that
        `replace` names as guides of their own repair.
    guide_offset : Fraction, int, float or str
        Time in the guide at which the input begins, seconds; below 0 if the guide begins later.

    Raises
    ------
    OptionError
        A value is never valid.
    """

    trim: Trim = Trim()
    input_fps: Annotated[Rate, Range(Fraction(1, 1000), 100_000)] | None = option(
        None, "Frame rate of images, or of a raw stream such as .264.", parse=parse_rate
    )
    stream: Annotated[int, Range(0)] | None = option(None, "Video stream, numbered as in probe; else the largest.")
    deinterlace: bool = option(False, "Make one frame per field: 50 per second from 25i.")
    size_change: SizeChange = option("stop", "If the frame size changes: stop or scale.")
    allow_playlists: bool = option(False, "Read playlists and the files that they name.")
    force_colours: bool = option(False, "Convert Dolby Vision of profile 5, in wrong colours.")
    decoder: Decoder = option("ffmpeg", "Decode videos with ffmpeg or opencv.")
    passes: str | None = option(
        None, "Layers of OpenEXR: all, beauty or their names.", metavar="NAMES", group="Streams"
    )
    view: View = option("none", "View transform of OpenEXR: none or srgb.")
    guide: PathName | None = option(None, "Cheap clip of the frames to be made, or own.", metavar="PATH")
    guide_offset: Rate = option(
        Fraction(0), "Where the input begins in the guide, seconds.", metavar="S", parse=parse_number
    )

    @property
    def guide_path(self) -> str | None:
        """Path of the guide; None without one, and where damaged frames are guides themselves."""
        return None if self.guide is None or self.guide == OWN else os.fspath(self.guide)

    @property
    def files(self) -> list[Path]:
        """Files of the guide, by whose content an output is told from others."""
        from fpsboost.io.images.source import find_images  # noqa: PLC0415 (which needs these options)

        path = self.guide_path
        if path is None:
            return []
        return [Path(path)] if Path(path).is_file() else find_images(path).files

    def absolute(self) -> Self:
        """Return the same options for programs in other folders."""
        return self if self.guide_path is None else replace(self, guide=os.path.abspath(self.guide_path))

    def names_given(self) -> set[str]:
        """Return the names of the options that are given, but not what ``own`` needs beside these options."""
        return super().names_given() - {f"guide={OWN!r}"}

    @property
    def given(self) -> list[str]:
        """Names of the options for video files that differ from the defaults."""
        for_others_too = {"start", "end", "passes", "view", "guide", "guide_offset"}
        return [f"`{each.name}`" for each, _ in given_fields(self) if each.name not in for_others_too]
