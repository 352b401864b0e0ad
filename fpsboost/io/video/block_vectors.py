"""Motion vectors of an H.264 stream that is encoded in memory: what `fpsboost.motion.block` needs of PyAV."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import av
import numpy as np
from av.codec.codec import UnknownCodecError
from av.codec.context import Flags2
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.io.video.encoding import repeatable_parameters

ENCODER = "libx264"

FRAME_RATE = 25  # frame rate of the stream, frames per second; any value will do

VECTOR_DTYPE = [(name, np.int32) for name in ("w", "h", "dst_x", "dst_y", "motion_x", "motion_y", "motion_scale")]

X264_PARAMETERS = "keyint=250:scenecut=0:bframes=0:ref=1:weightp=0:threads=1"
"""Options for an intra-coded first frame and a second frame predicted from it alone, without weighted prediction; the
same stream on any number of cores."""


def read_block_vectors(reference: NDArray[Any], predicted: NDArray[Any], crf: int, preset: str) -> NDArray[Any]:
    """Encode two pictures and return the vectors of the second, one AVMotionVector per block.

    Both are planes of yuv420p below each other, (H * 3 / 2, W) uint8. Raises `OptionError` where FFmpeg has no x264.
    """
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    decoder.flags2 |= Flags2.export_mvs
    decoder.thread_count = 1
    packets = _encode((reference, predicted), crf, preset)
    frames = [frame for packet in [*packets, None] for frame in decoder.decode(packet)]
    vectors = frames[1].side_data.get("MOTION_VECTORS")
    # a copy: the array refers to memory that is freed with the frame
    return np.empty(0, VECTOR_DTYPE) if vectors is None else vectors.to_ndarray().copy()


def _encode(pictures: tuple[NDArray[Any], ...], crf: int, preset: str) -> list[av.Packet[Any]]:
    try:
        encoder = av.CodecContext.create(ENCODER, "w")
    except UnknownCodecError as error:
        raise OptionError(f"The method codec needs {ENCODER}, which this FFmpeg lacks; take block.") from error
    assert isinstance(encoder, av.VideoCodecContext)
    frames = [av.VideoFrame.from_ndarray(picture, format="yuv420p") for picture in pictures]
    encoder.width, encoder.height, encoder.pix_fmt = frames[0].width, frames[0].height, "yuv420p"
    encoder.time_base, encoder.framerate = Fraction(1, FRAME_RATE), Fraction(FRAME_RATE)
    parameters = ":".join([X264_PARAMETERS, *repeatable_parameters])
    encoder.options = {"crf": str(crf), "preset": preset, "x264-params": parameters}
    packets: list[av.Packet[Any]] = []
    for number, frame in enumerate(frames):
        frame.pts = number
        packets += encoder.encode(frame)
    return [*packets, *encoder.encode(None)]
