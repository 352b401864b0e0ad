"""Write a video file: frames become pictures in the coding of its encoder, which a writer of media encodes."""

from functools import cached_property

import av
import numpy as np
from av.video.reformatter import VideoReformatter

from fpsboost.colour import Coding
from fpsboost.frame import Frame
from fpsboost.image import Pixels
from fpsboost.io.output import check_frame_size
from fpsboost.io.video.ycc import as_picture
from fpsboost.media import (
    BT709,
    BT2020,
    CAPTIONS,
    MASTERING,
    FileWriter,
    PartWriter,
    Remark,
    VideoEncoder,
    VideoTraits,
    Writer,
    depth_of,
    explained_writing,
    has_alpha,
    primaries,
    transfers,
)
from fpsboost.memory import return_free_memory
from fpsboost.remarks import Remarks


class FrameWriter(Writer):
    """Writer of frames as a video; see `fpsboost.media.writer.Writer`.

    Frames of video stay in the planes of their pictures where the encoder takes these; others are converted from BGR.
    """

    holds_last_frame = True

    @property
    def remarks(self) -> list[Remark]:
        """What the file does not hold."""
        return [*super().remarks, *self._lost]

    @cached_property
    def _lost(self) -> Remarks:
        """What frames have held and the file does not."""
        return Remarks()

    @cached_property
    def _reformatter(self) -> VideoReformatter:
        return VideoReformatter()

    def write(self, frame: Frame) -> None:
        """Encode the next frame, unless an earlier run has finished it.

        Times are rounded to ticks of the output's time base and must increase by at least one. Raises `OutputError` if
        they do not, if the frame has another size, or if encoding or writing fails.
        """
        output = self._output
        check_frame_size(frame, output.info, output.path)
        encoder = self.encoder or self.start(traits_of_image(frame.pixels, output.stream.colours))
        self._remark_on(frame, encoder)
        picture = None if self.is_complete else self._picture(frame, encoder)
        is_original = picture is not None and picture is frame.original
        if self.encode(picture, frame.time, frame.duration, is_original=is_original, captions=frame.captions):
            return_free_memory()  # of the encoder, which lived as long as its packets

    def _picture(self, frame: Frame, encoder: VideoEncoder) -> av.VideoFrame:
        """Return the picture of a frame in the coding of the encoder."""
        traits = encoder.traits
        pixel_format = encoder.pixel_format
        coding = Coding(
            depth_of(pixel_format), traits.color_space, encoder.full_range, traits.chroma_location, pixel_format
        )
        with explained_writing(self._output.path):  # decoded pictures are used where the source is video
            return as_picture(frame, coding, self._reformatter, keeps_original=self._output.stream.traits is not None)

    def _remark_on(self, frame: Frame, encoder: VideoEncoder) -> None:
        """Remark on alpha, depth, light and closed captions of a frame that the output lacks."""
        name = self._output.path
        if frame.image.shape[2] == 4 and not has_alpha(encoder.pixel_format):
            self._lost.add("alpha-not-held", name=name)
        if frame.image.dtype == np.float32:
            if depth_of(encoder.pixel_format) == 16:  # with fewer bits a remark exists already
                self._lost.add("floats-in-16-bits", name=name)
            if np.logical_or(frame.array[..., :3] < 0, frame.array[..., :3] > 1).any():
                self._lost.add("light-clipped", name=name)
        # those of the first frame are said by the encoder
        if frame.captions and not encoder.keeps_captions and CAPTIONS not in encoder.traits.side_data:
            self._lost.add("captions-lost", name=name)


class VideoSink(FrameWriter, FileWriter):
    """Sink of a whole video file; see `fpsboost.media.writer.FileWriter` for its parameters and errors."""


class VideoPartSink(FrameWriter, PartWriter):
    """Sink of a part of a video, in a folder of its own; see `fpsboost.media.writer.PartWriter`."""


def traits_of_image(image: Pixels | None, colours: VideoTraits) -> VideoTraits:
    """Return the traits to write for images: limited range, own channels and depth, and the colours that they name.

    Colours that they do not name, or by unknown numbers, are tagged as BT.709. Y, Cb and Cr are made by the matrix of
    BT.2020 for its primaries, otherwise by that of BT.709.
    """
    channels = 3 if image is None else image.shape[2]
    deep = image is not None and image.dtype != np.uint8
    matrix = BT2020 if colours.color_primaries == BT2020 else BT709
    return VideoTraits(
        {1: "gray", 3: "gbrp"}.get(channels, "gbrap") + ("16le" if deep else ""),
        color_space=matrix,
        tagged_color_space=matrix,
        color_primaries=colours.color_primaries if colours.color_primaries in primaries else BT709,
        color_transfer=colours.color_transfer if colours.color_transfer in transfers else BT709,
        mastering_display=colours.mastering_display,
        light_level=colours.light_level,
        side_data={kind: word for kind, word in colours.side_data.items() if word == MASTERING},
    )
