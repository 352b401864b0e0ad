"""Read a video file: its clip's pictures as frames, in planes or as BGR."""

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import replace
from fractions import Fraction

import av

from fpsboost.errors import InputError
from fpsboost.frame import Frame
from fpsboost.image import Image
from fpsboost.io.output import StreamInfo
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.ycc import coding_of, in_planes, is_on_its_side, to_bgr, turned_upright
from fpsboost.media import (
    MASTERING,
    Clip,
    Reading,
    TimedPicture,
    captions_of,
    has_alpha,
)
from fpsboost.memory import MemoryLimit
from fpsboost.options import PathName
from fpsboost.threads import decoder_threads


class VideoSource(Clip):
    """Frames of one video stream of a file, decoded by FFmpeg in presentation order.

    Opening reads headers and the first packets, and decodes nothing, except with `for_images`. A source can be iterated
    over once.

    Parameters
    ----------
    path : str or os.PathLike
        Video file; messages name it as it is given here.
    for_images : bool
        Set for targets that hold pictures alone. Pictures are turned upright by the display matrix of the file, streams
        and side data that are lost are remarked, and frames keep no reference to the decoder's picture
        (`Frame.original` is None). The first picture is decoded at once, to know the size.
    keeps_alpha : bool
        Yield BGRA where the file has alpha; otherwise alpha is left out, with a remark.
    keeps_planes : bool
        Keep Y'CbCr pictures as `fpsboost.image.YCbCrImage` instead of converting them to BGR; others become BGR anyway.
        Without effect with `for_images`.
    decoding : DecodeOptions, optional
        Stream, trim, frame rate and other choices of the user; FFmpeg's best stream and its own times by default.
    limit : MemoryLimit, optional
        Limit that the size of the pictures is checked against; by default the free memory.

    Raises
    ------
    InputError
        The file cannot be read, holds no video, is too large for `limit`, or is encrypted in the part to be read. While
        iterating also: it is read a second time, cannot be converted, or differs from its frame index.
    OptionError
        `decoding` names a stream that is no video, or a frame rate for a file that declares its own.
    """

    def __init__(
        self,
        path: PathName,
        *,
        for_images: bool = False,
        keeps_alpha: bool = False,
        keeps_planes: bool = False,
        decoding: DecodeOptions = DecodeOptions(),
        limit: MemoryLimit | None = None,
    ) -> None:
        self._for_images = for_images
        self._keeps_planes = keeps_planes and not for_images
        reading = Reading(
            decoding.stream,
            None if decoding.input_fps is None else Fraction(decoding.input_fps),
            deinterlace=decoding.deinterlace,
            size_change=decoding.size_change,
            keeps_alpha=keeps_alpha,
            allow_playlists=decoding.allow_playlists,
            force_colours=decoding.force_colours,
            end=None if decoding.trim.end is None else decoding.trim.end.seconds,
            threads=decoder_threads(),
            check_size=(limit or MemoryLimit()).check,
        )
        super().__init__(path, reading)
        if for_images:
            traits = self.traits
            if is_on_its_side(traits.display_matrix):
                self.info = replace(self.info, width=self.info.height, height=self.info.width)
            # PNG keeps the mastering metadata, and the sinks of other formats report its loss themselves
            sides = dict.fromkeys(word for word in traits.side_data.values() if word != MASTERING)
            lost = [*self.file.auxiliary_streams, *sides]
            if lost:
                self.remarks.add("beside-left-out", name=self.info.name, what=" and ".join(lost), target="images")
            if traits.sample_aspect_ratio not in (None, 1):
                self.remarks.add("shape-lost-in-images", name=self.info.name, shape=traits.sample_aspect_ratio)

    @property
    def stream_info(self) -> StreamInfo:
        """Streams and traits that a sink may carry over; reading it decodes the first frame."""
        return StreamInfo(traits=self.traits, video=self.file, files=[self.path])

    def __iter__(self) -> Iterator[Frame]:
        """Return an iterator over the frames; a second call raises `InputError`."""
        return self._frames(self.pictures())

    def _frames(self, pictures: Generator[TimedPicture, None, None]) -> Iterator[Frame]:
        """Yield pictures as frames."""
        coding = coding_of(self.traits) if self._keeps_planes else None
        with closing(pictures):  # which adds the remarks of the clip, also where not all of it was asked for
            for picture, time, duration in pictures:
                image = self._convert(picture) if coding is None else in_planes(picture, coding)
                original = None if self._for_images else picture
                yield Frame(image, time, duration, original, captions=captions_of(picture))

    def _convert(self, picture: av.VideoFrame) -> Image:
        """Convert a picture to BGR or BGRA, upright for images; raise `InputError` if FFmpeg cannot."""
        try:
            keeps_alpha = self._reading.keeps_alpha and has_alpha(picture.format.name)
            image = to_bgr(picture, self._reformatter, keeps_alpha=keeps_alpha)
        except (av.error.FFmpegError, ValueError):
            raise InputError(
                f"{self.info.name} has the pixel format {picture.format.name}, which cannot be converted to BGR; "
                "convert it to yuv444p16le first."
            ) from None
        return turned_upright(image, self.traits.display_matrix) if self._for_images else image
